"""Speed of the environment's step, beside the physics that it contains and beside C MuJoCo."""

from __future__ import annotations

import gc
from collections.abc import Callable, Sequence

import mujoco
import mujoco_warp as mjw
import numpy as np
import torch
import warp as wp
from mujoco.rollout import Rollout

from spin_rl import robot
from spin_rl.benchmark.tables.paper import FRAMES_PER_S
from spin_rl.machine import num_cores
from spin_rl.scenes.builder import PARKED_Z_M, native_model
from spin_rl.scenes.layout import Scene
from spin_rl.sim.graph import StepGraph
from spin_rl.speed.rows import Row, rate_row
from spin_rl.speed.timing import Stopwatch, Subject, Timing, interleave
from spin_rl.tasks.nav.env import NavEnv

WARM_UP_STEPS = 100
NATIVE_WORLDS = 64  # models that C MuJoCo compiles one by one
_BANK_STEPS = 160
_HOLD_STEPS = 8
_UNIT = "env steps/s"
# All that a physics step reads and an episode changes, beside the geom sizes, which the models share.
_STATE = ("time", "qpos", "qvel", "qacc_warmstart", "ctrl", "geom_xpos", "geom_xmat")


class RandomDriver:
    """Drives an environment by random set-points, held for a while, that go forward more often than back.

    Episodes then end at different times, by collisions mostly, as they do early in training.
    """

    def __init__(self, env: NavEnv, seed: int, warm_up_steps: int = WARM_UP_STEPS) -> None:
        """Draw the actions, and step until the episodes of the worlds are out of step."""
        self.env = env
        generator = torch.Generator().manual_seed(seed)
        held = _BANK_STEPS // _HOLD_STEPS
        actions = 2.0 * torch.rand(held, env.num_envs, len(robot.ACTIONS), generator=generator) - 1.0
        actions[..., 0] = 0.6 * actions[..., 0] + 0.4
        self._bank = actions.repeat_interleave(_HOLD_STEPS, dim=0).to(env.device)
        self.steps = 0
        for _ in range(warm_up_steps):
            self.step()

    def step(self) -> None:
        """Step the environment once."""
        self.env.step(self._bank[self.steps % len(self._bank)])
        self.steps += 1


class BarePhysics:
    """The captured `mjw.step` calls of one control step and nothing else, on the same model."""

    def __init__(self, env: NavEnv) -> None:
        """Allocate a second state and capture."""
        sim = env.sim
        with wp.ScopedDevice(env.device):
            self._data = mjw.make_data(
                sim.mj_model,
                nworld=env.num_envs,
                nconmax=sim.config.contacts_per_world,
                njmax=sim.config.constraints_per_world,
            )
        self._pairs = [
            (wp.to_torch(getattr(self._data, name)), wp.to_torch(getattr(sim.data, name))) for name in _STATE
        ]

        def launch() -> None:
            for _ in range(sim.config.substeps):
                mjw.step(sim.model, self._data)

        self._graph = StepGraph(launch, env.device)

    def copy_state(self) -> None:
        """Take over the environment's state in all worlds: scenes, motion and current set-points."""
        for own, theirs in self._pairs:
            own.copy_(theirs)

    def step(self) -> None:
        """Replay the physics of one control step, the set-points held."""
        self._graph.replay()


class NativeRollout:
    """The same physics in C MuJoCo: `mujoco.rollout` of one control step from the environment's state."""

    def __init__(self, env: NavEnv, nworld: int) -> None:
        """Compile the scenes of the first worlds as they are now, and copy their states and set-points."""
        sim = env.sim
        self.nworld = min(nworld, env.num_envs)
        self._models = [
            _full_model(scene, sim.mj_model) for scene in sim.layout.scenes(list(range(self.nworld)))
        ]
        qpos, qvel, ctrl = (getattr(sim.data, name).numpy() for name in ("qpos", "qvel", "ctrl"))
        data = mujoco.MjData(self._models[0])
        spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
        size = mujoco.mj_stateSize(self._models[0], spec)
        self._states = np.zeros((self.nworld, size))
        for world in range(self.nworld):
            data.qpos[:], data.qvel[:] = qpos[world], qvel[world]
            mujoco.mj_getState(self._models[0], data, self._states[world], spec)
        substeps = sim.config.substeps
        self._ctrl = np.repeat(ctrl[: self.nworld, None].astype(np.float64), substeps, axis=1)
        self._out = np.zeros((self.nworld, substeps, size))
        self._sensors = np.zeros((self.nworld, substeps, self._models[0].nsensordata))

    def runner(self, num_threads: int) -> Callable[[], np.ndarray]:
        """A function that runs all worlds once on some threads and returns their last states."""
        pool = Rollout(nthread=num_threads if num_threads > 1 else 0)
        data = [mujoco.MjData(self._models[0]) for _ in range(num_threads)]

        def run() -> np.ndarray:
            pool.rollout(
                self._models, data, self._states, self._ctrl, state=self._out, sensordata=self._sensors
            )
            return self._out[:, -1]

        return run


def measure_env(
    driver: RandomDriver,
    seconds: float,
    watch: Stopwatch,
    *,
    native_worlds: int = NATIVE_WORLDS,
) -> list[Row]:
    """Time an environment's step against its own physics and against C MuJoCo.

    Bare physics starts every time from the state that the environment has then, scenes included, so that both
    meet the same contacts. The peers do physics only: no resets, scandots, rewards or observations.

    Args:
        driver: Steps the environment, which is warmed up.
        seconds: Time to measure for.
        watch: Waits for the device.
        native_worlds: Worlds of the C MuJoCo peer.
    """
    env = driver.env
    bare = BarePhysics(env)
    native = NativeRollout(env, native_worlds)

    def time_bare(calls: int) -> float:
        elapsed = 0.0
        for _ in range(calls):
            driver.step()
            bare.copy_state()
            elapsed += watch.time(bare.step)
        return elapsed

    subjects = {
        "env": Subject(lambda calls: watch.time(driver.step, calls), env.num_envs),
        "bare": Subject(time_bare, env.num_envs),
    }
    threads = {1, num_cores()}
    for count in sorted(threads):
        run = native.runner(count)
        subjects[f"native {count}"] = Subject(lambda n, run=run: watch.time(run, n), native.nworld)
    times = interleave(subjects, seconds)

    substeps = env.sim.config.substeps
    rows = [
        rate_row("env step", times["env"], _UNIT, f"its {substeps} captured mjw.step alone", times["bare"])
    ]
    for count in sorted(threads):
        label = f"C MuJoCo mujoco.rollout, physics only, {_threads(count)}"
        rows.append(rate_row("env step", times["env"], _UNIT, label, times[f"native {count}"]))
    label = f"C MuJoCo mujoco.rollout, {_threads(1)}"
    rows.append(rate_row(f"{substeps} captured mjw.step", times["bare"], _UNIT, label, times["native 1"]))
    return rows


def measure_images(with_images: RandomDriver, without: RandomDriver, seconds: float, watch: Stopwatch) -> Row:
    """Time the environment's step with depth images against the same without, in turns.

    Scandots are computed in both.

    Args:
        with_images: Steps an environment with a depth camera, warmed up.
        without: Steps one without, otherwise the same.
        seconds: Time to measure for.
        watch: Waits for the device.
    """
    drivers = {"with": with_images, "without": without}
    subjects = {
        name: Subject(lambda calls, step=driver.step: watch.time(step, calls), driver.env.num_envs)
        for name, driver in drivers.items()
    }
    times = interleave(subjects, seconds)
    paper = FRAMES_PER_S["depth"] / FRAMES_PER_S["scandots"]
    label = f"env step without images, in the paper {paper:.3f}x"
    return rate_row("env step with depth images", times["with"], _UNIT, label, times["without"])


def sweep(
    make_env: Callable[[int], NavEnv],
    counts: Sequence[int],
    device: str,
    seconds: float,
    seed: int,
    watch: Stopwatch,
) -> list[Row]:
    """Time environments of several sizes, each against the smallest one, and measure GPU memory.

    Args:
        make_env: Builds an environment of some worlds.
        counts: Numbers of worlds.
        device: Device of the environments.
        seconds: Time for each.
        seed: Seed of the actions.
        watch: Waits for the device.

    Returns:
        A row of steps/s for each count and, on CUDA, one of the memory that the device has given up by then.
    """
    rows: list[Row] = []
    first: Timing | None = None
    used_before = _memory_used(device)
    for count in sorted(set(counts)):
        gc.collect()
        env = make_env(count)
        driver = RandomDriver(env, seed)
        subject = Subject(lambda n, driver=driver: watch.time(driver.step, n), count)
        timing = interleave({"env": subject}, seconds)["env"]
        label = None if first is None else f"env step, {min(counts)} worlds"
        rows.append(rate_row(f"env step, {count} worlds", timing, _UNIT, label, first))
        if device != "cpu":
            memory = (_memory_used(device) - used_before) / 2**20
            rows.append(Row(f"GPU memory, {count} worlds", memory, "MiB", None, None, (memory, memory), None))
        first = first or timing
        del env, driver, subject
    return rows


def _full_model(scene: Scene, like: mujoco.MjModel) -> mujoco.MjModel:
    """Compile a scene with all its slots, so that all models have one size; options as in `like`."""
    scene.pos[~scene.active, 2] = PARKED_Z_M
    scene.active[:] = True
    model = native_model(scene)
    for name in ("timestep", "iterations", "ls_iterations"):
        setattr(model.opt, name, getattr(like.opt, name))
    return model


def _threads(count: int) -> str:
    return "1 thread" if count == 1 else f"{count} threads"


def _memory_used(device: str) -> int:
    """Bytes of a GPU's memory in use by anyone, 0 for the CPU."""
    if device == "cpu":
        return 0
    torch.cuda.synchronize(device)
    free, total = torch.cuda.mem_get_info(device)
    return total - free
