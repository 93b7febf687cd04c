"""A toy in which scandots and an object can be read off an image, and students for it."""

from __future__ import annotations

import torch
from fake_env import NUM_ACTIONS, FakeEnv, make_config

from spin_rl.models import ScandotRecurrentModel
from spin_rl.runners import read_policy
from spin_rl.runners.distillation.algorithm import Distillation
from spin_rl.runners.distillation.sequences import Sequences
from spin_rl.runners.distillation.student import student_config

IMAGE = (8, 16)
ENCODER = {"image": list(IMAGE), "channels": [6], "kernels": [3], "strides": [2], "hidden": [32]}


class DepthEnv(FakeEnv):
    """The image is the visible tokens, as 8-bit numbers; the object is the first of them, in other units.

    The last action is the camera's.
    """

    camera_actions = (NUM_ACTIONS - 1,)

    def _observe(self):
        super()._observe()
        image = self.observations["scandots"].clamp(-2.0, 2.0) * 60.0 + 128.0
        self.observations["depth"] = image.to(torch.uint8)
        self.observations["object"] = 3.0 * self.observations["scandots"][:, :10] + 1.0


def make_student_config(teacher, **algorithm) -> dict:
    """Configuration of a distillation from a run's folder."""
    return {
        "seed": 1,
        "num_steps_per_env": 8,
        "save_interval": 100,
        **student_config(read_policy(teacher).metadata, ENCODER),
        "algorithm": {
            "class_name": "spin_rl.runners.distillation.algorithm:Distillation",
            "teacher": str(teacher),
            "num_mini_batches": 2,
            "freeze_iterations": 3,
            **algorithm,
        },
    }


def make_models(seed: int = 0, seen: str = "scandots") -> tuple[ScandotRecurrentModel, ScandotRecurrentModel]:
    """A student and a teacher with random weights, which sees scandots or the object."""
    torch.manual_seed(seed)
    obs = DepthEnv(num_envs=4).get_observations()
    section = {k: v for k, v in make_config()["actor"].items() if k not in ("class_name", "distribution_cfg")}
    groups = ["proprio", "goal"]
    latent = 10 if seen == "object" else 16
    student = ScandotRecurrentModel(
        obs,
        {"actor": [*groups, "depth"]},
        "actor",
        NUM_ACTIONS,
        depth_encoder=ENCODER,
        scandot_latent=latent,
        **section,
    )
    teacher = ScandotRecurrentModel(obs, {"actor": [*groups, seen]}, "actor", NUM_ACTIONS, **section)
    return student, teacher


def make_algorithm(num_steps: int = 6, num_envs: int = 4, seen: str = "scandots", **settings) -> Distillation:
    """An algorithm without an environment."""
    student, teacher = make_models(seen=seen)
    obs = DepthEnv(num_envs=num_envs).get_observations()
    sequences = Sequences.allocate(obs, student, num_steps, NUM_ACTIONS, "cpu")
    settings = {"num_mini_batches": 1, "freeze_iterations": 0, **settings}
    return Distillation(student, teacher, sequences, DepthEnv.camera_actions, **settings)


def collect(algorithm: Distillation, env: DepthEnv, steps: int | None = None) -> int:
    """Fill the algorithm's memory with a rollout; return how many episodes ended."""
    obs, ends = env.get_observations(), 0
    with torch.no_grad():
        for _ in range(algorithm.sequences.num_steps if steps is None else steps):
            obs, rewards, dones, extras = env.step(algorithm.act(obs))
            algorithm.process_env_step(obs, rewards, dones, extras)
            ends += int(dones.sum())
    return ends
