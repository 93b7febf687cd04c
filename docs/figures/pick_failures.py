"""How picks that time out differ from those that succeed: prints medians told in docs/experiments.md.

    PYTHONPATH=. python docs/figures/pick_failures.py [policy] [object]

100 episodes of 7 s in scenes of their own; a success does not end one. Medians over worlds and steps: how
many pixels of the policy's image show the object, by the simulator's detector in an image with 16 times as
many, how far the grasp centre is from the object, along and across the gripper and upwards, how far the
fingers are open, and how far the object is lifted.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import torch
import warp as wp

from spin_rl.benchmark import settings
from spin_rl.benchmark.policies import open_policy
from spin_rl.tasks.common.compose import compose
from spin_rl.tasks.common.episode import SUCCESS, TIMEOUT
from spin_rl.tasks.common.formulas import NEAR_PER_M
from spin_rl.tasks.pick.env import PickEnv
from spin_rl.tasks.pick.observations import PRIVILEGED
from spin_rl.tasks.pick.spec import PICK

WORLDS = 100
SEED = 500
SPANS_S = ((1.5, 2.5), (3.0, 4.0), (5.0, 6.9))
PERIOD_S = 0.1
FINER = 16


def run(policy: str, kind: str) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return what is measured in every step of every world, and how their episodes end."""
    asked = ["task=pick", f"task.object={kind}"]
    source = open_policy(policy)
    cfg = PICK.configure(settings.for_policy(compose("eval", asked), source.trained, asked))
    if cfg.detector == "none" and "object" in source.trained["runner"]["obs_groups"]["actor"]:
        sys.exit(f"{policy} is told where the object is without a detector")
    env = PickEnv(replace(cfg, detector="segmentation", end_on_success=False), WORLDS, "cpu", SEED)
    detector = env.sight._detector
    assert detector is not None
    pixels = wp.to_torch(detector.num_pixels)
    start = sum(list(PRIVILEGED.values())[: list(PRIVILEGED).index("offset")])
    obs = env.reset()
    actor = source.make(obs, "cpu")
    rows: dict[str, list[np.ndarray]] = {"pixels": [], "offset": [], "distance": [], "open": [], "lift": []}
    ends = torch.zeros(WORLDS, dtype=torch.int32)
    for _ in range(env.max_episode_length):
        with torch.inference_mode():
            action = actor(obs)
        obs, _, dones, _ = env.step(action)
        ends = torch.where((ends == 0) & (dones > 0), env.outcome.int(), ends)
        step = env.last_transition
        assert step is not None
        for name, values in (
            ("pixels", pixels / FINER),
            ("offset", obs["privileged"][:, start : start + 3] / NEAR_PER_M),
            ("distance", step.distance),
            ("open", step.finger),
            ("lift", step.height),
        ):
            rows[name].append(values.numpy().copy())
    return {name: np.stack(values) for name, values in rows.items()}, ends.numpy()


def main(policy: str = "pick-depth", kind: str = "banana") -> None:
    """Print one line for each end and span of time."""
    table, ends = run(policy, kind)
    print(f"{policy}, {WORLDS} x {kind}")
    for name, code in (("success", SUCCESS), ("timeout", TIMEOUT)):
        chosen = ends == code
        print(f"{name}: {chosen.sum()} episodes")
        for begin, end in SPANS_S if chosen.any() else ():
            span = slice(round(begin / PERIOD_S), round(end / PERIOD_S))
            values = {key: value[span][:, chosen] for key, value in table.items()}
            off = np.median(np.abs(values["offset"]), axis=(0, 1)) * 1000
            print(
                f"  {begin} to {end} s: {np.median(values['pixels']):.0f} pixels, "
                f"distance {np.median(values['distance']) * 1000:.0f} mm "
                f"(out {off[0]:.0f}, across {off[1]:.0f}, up {off[2]:.0f}), "
                f"fingers {np.median(values['open']):.2f} rad, "
                f"lifted {np.median(values['lift']) * 1000:.0f} mm"
            )


if __name__ == "__main__":
    main(*sys.argv[1:])
