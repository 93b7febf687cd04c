"""Nothing in a step waits for the device, as far as a machine without a GPU can tell.

Steps run on the CPU while every Torch operation is watched. Copies from the host, and what is done on CUDA
alone, are not noticed; PointNet chooses tokens on the CPU in a way of its own and is replaced.
"""

import pytest
import torch
from distill_worlds import DepthEnv, make_models
from fake_env import FakeEnv, make_config
from torch.utils._python_dispatch import TorchDispatchMode

from spin_rl.runners import PPO
from spin_rl.runners.distillation.algorithm import Distillation
from spin_rl.runners.distillation.sequences import Sequences
from spin_rl.sensors.depth.pipeline import DepthConfig
from spin_rl.tasks.fetch.config import FetchConfig
from spin_rl.tasks.fetch.env import FetchEnv
from spin_rl.tasks.nav.config import NavConfig, NavNoise
from spin_rl.tasks.nav.env import NavEnv
from spin_rl.tasks.pick.config import PickConfig, PickNoise
from spin_rl.tasks.pick.env import PickEnv

aten = torch.ops.aten
# Of these the result, its shape or a check needs numbers on the host.
WAITS = {
    aten._local_scalar_dense,
    aten.equal,
    aten.is_nonzero,
    aten.masked_select,
    aten.nonzero,
    aten.repeat_interleave,
    aten.unique_consecutive,
    aten._unique2,
}
WAITS_BY_OVERLOAD = {aten.normal.Tensor_Tensor, aten.normal.float_Tensor, aten.bernoulli.p}


class Watcher(TorchDispatchMode):
    """Refuses operations that would wait for a GPU."""

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        by_mask = func.overloadpacket in (aten.index, aten.index_put, aten.index_put_, aten._index_put_impl_)
        if by_mask:
            by_mask = any(index is not None and index.dtype in (torch.bool, torch.uint8) for index in args[1])
        if func.overloadpacket in WAITS or func in WAITS_BY_OVERLOAD or by_mask:
            raise AssertionError(f"{func} waits for the device")
        return func(*args, **(kwargs or {}))


@pytest.mark.parametrize(
    "wait",
    [
        lambda x: x.sum().item(),
        lambda x: bool((x > 0).any()),
        lambda x: x[x > 0],
        lambda x: x.nonzero(),
        lambda x: x.__setitem__(x > 0, torch.zeros(1)),
        lambda x: torch.distributions.Normal(x, x.exp()).sample(),
    ],
)
def test_watcher_notices(wait):
    with Watcher(), pytest.raises(AssertionError, match="waits"):
        wait(torch.arange(3.0))


NAV = NavConfig(
    reward={"success": 1.0, "clearance": -1.0},
    depth=DepthConfig(),
    noise=NavNoise(0.1, 0.1, 0.1, 0.1, 0.1),
)
PICK = PickConfig(depth=DepthConfig(), noise=PickNoise(0.1, 0.1, 0.1, 0.1, 0.1))
FETCH = FetchConfig(depth=DepthConfig(), pick_range_m=(0.5, 1.5))


@pytest.mark.parametrize(("kind", "cfg"), [(NavEnv, NAV), (PickEnv, PICK), (FetchEnv, FETCH)])
def test_step_of_a_task(device, kind, cfg):
    env = kind(cfg, 4, device, seed=1)
    actions = torch.zeros(4, env.num_actions, device=device)
    with Watcher():
        for _ in range(2):
            env.step(actions)


@pytest.mark.parametrize("critic", ["feed_forward", "recurrent"])
def test_rollout_of_ppo(critic):
    env = FakeEnv()
    cfg = make_config(critic) | {"multi_gpu": None}
    cfg["actor"]["distribution_cfg"] = {
        "class_name": "spin_rl.models:PerActionGaussian",
        "init_std": [1.0, 0.5],
    }
    for model in ("actor", "critic"):
        cfg[model] = cfg[model] | {"encoder": "concat"}
    algorithm = PPO.construct_algorithm(env.get_observations(), env, cfg, "cpu")
    obs = env.get_observations()
    with torch.no_grad():
        for _ in range(algorithm.storage.num_steps):
            with Watcher():
                actions = algorithm.act(obs)
            obs, *outcome = env.step(actions)
            with Watcher():
                algorithm.process_env_step(obs, *outcome)
        with Watcher():
            algorithm.compute_returns(obs)


def test_distillation():
    env = DepthEnv()
    student, teacher = make_models(seen="object")
    obs = env.get_observations()
    algorithm = Distillation(student, teacher, Sequences.allocate(obs, student, 3, env.num_actions, "cpu"))
    for _ in range(algorithm.sequences.num_steps):
        with torch.no_grad(), Watcher():
            actions = algorithm.act(obs)
        obs, *outcome = env.step(actions)
        with torch.no_grad(), Watcher():
            algorithm.process_env_step(obs, *outcome)
    with Watcher():
        algorithm._learn_from(algorithm.sequences)
