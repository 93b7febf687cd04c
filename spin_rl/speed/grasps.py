"""How well a scripted pinch holds the five objects, and what a world-step with one costs.

Run ``python -m spin_rl.speed.grasps --worlds 250``. The gripper starts around the object, which lies any
way round, closes, lifts by 0.25 m at 0.4 m/s and holds. Nothing is aimed: it shows what a grasp without
thought does, not what a policy can do.
"""

from __future__ import annotations

import argparse
import math
import time
from typing import Any, cast

import mujoco
import torch
import warp as wp
from omegaconf import OmegaConf

from spin_rl import robot
from spin_rl.config import from_mapping
from spin_rl.paths import CONF_DIR
from spin_rl.scenes.builder import native_model
from spin_rl.scenes.layout import PoolSpec
from spin_rl.scenes.objects.shapes import OBJECTS
from spin_rl.scenes.tabletops.generator import generate_tabletops
from spin_rl.scenes.tabletops.params import TabletopParams
from spin_rl.sim.config import SimConfig
from spin_rl.sim.graph import StepGraph
from spin_rl.sim.simulation import Simulation
from spin_rl.sim.targets import ManipulationConfig
from spin_rl.speed.timing import Stopwatch

CLOSE_STEPS, LIFT_STEPS, HOLD_STEPS = 10, 6, 6
GRIP_N = 10.0
_NATIVE_WORLDS = 20
_PARAMS = TabletopParams(near_distance=(0.0, 0.0), near_above=(0.0, 0.005), max_distractors=0, wall_share=0.0)


class ScriptedGrasps:
    """Worlds in which the open gripper is around an object on a table."""

    def __init__(self, nworld: int, seed: int, device: str) -> None:
        """Draw scenes and start them.

        Args:
            nworld: Number of worlds; the objects take turns.
            seed: Seed of the scenes.
            device: Warp device.
        """
        values = OmegaConf.to_container(OmegaConf.load(CONF_DIR / "sim" / "grasp.yaml"))
        self.config = from_mapping(SimConfig, cast(dict[str, Any], values), "sim")
        profile = robot.SPEED_PROFILES["paper"]
        self.sim = Simulation(
            nworld, PoolSpec(), profile, self.config, device, manipulation=ManipulationConfig()
        )
        self._site = self.sim.mj_model.site(robot.GRASP_CENTER_SITE).id
        self._action = torch.zeros_like(self.sim.views.action)
        with wp.ScopedDevice(device):
            every = wp.full(nworld, True, dtype=bool)
            generate_tabletops(
                self.sim.layout,
                self.sim.object.start,
                _PARAMS,
                seed=wp.array([seed], dtype=wp.int32),
                counter=wp.zeros(nworld, dtype=wp.int32),
                mask=every,
                level=wp.zeros(nworld, dtype=float),
                near_share=wp.full(nworld, 1.0, dtype=float),
                kind_choice=wp.array([i % len(OBJECTS) for i in range(nworld)], dtype=wp.int32),
            )
            self.sim.advance()
            self.sim.reset(every)
            self.sim.forward()
        self._graph = StepGraph(self.sim.advance, device)

    def act(self, steps: int, **actions: float) -> None:
        """Repeat an action, given by joint, for some control steps."""
        self._action.zero_()
        for name, value in actions.items():
            self._action[:, robot.ACTIONS.index(name)] = value
        for _ in range(steps):
            self.sim.views.action.copy_(self._action)
            self._graph.replay()

    def in_gripper(self) -> torch.Tensor:
        """Return the objects' positions in the gripper's frame [m], shape (nworld, 3)."""
        with wp.ScopedDevice(self.sim.device):
            self.sim.forward()
        turn = wp.to_torch(self.sim.data.site_xmat)[:, self._site].view(-1, 3, 3)
        offset = self.sim.object.views.pos - self.sim.views.site_pos[:, self._site]
        return torch.einsum("nij,ni->nj", turn, offset)

    def native_step_s(self) -> float:
        """Return the seconds that C MuJoCo takes for a control step from the states the worlds are in now."""
        seconds = 0.0
        worlds = range(0, self.sim.nworld, math.ceil(self.sim.nworld / _NATIVE_WORLDS))
        for world in worlds:
            model = native_model(self.sim.layout, world, obj=self.sim.object.scene_object(world))
            model.opt.timestep, model.opt.iterations = self.config.timestep, self.config.iterations
            model.opt.ls_iterations = self.config.ls_iterations
            data = mujoco.MjData(model)
            data.qpos[:] = self.sim.data.qpos.numpy()[world]
            data.qvel[:] = self.sim.data.qvel.numpy()[world]
            data.ctrl[:] = self.sim.data.ctrl.numpy()[world]
            start = time.process_time()
            mujoco.mj_step(model, data, self.config.substeps)
            seconds += time.process_time() - start
        return seconds / len(worlds)


def run(nworld: int, seed: int, device: str) -> None:
    """Run the script once and print what it did."""
    worlds = ScriptedGrasps(nworld, seed, device)
    views, forces = worlds.sim.object.views, worlds.sim.grasp.views
    start = views.pos.clone()
    worlds.act(CLOSE_STEPS, gripper_finger=-1.0)
    held = worlds.in_gripper()
    on_gpu = wp.get_device(device).is_cuda
    stopwatch = Stopwatch(torch.cuda.synchronize) if on_gpu else Stopwatch(clock=time.process_time)
    lifting = stopwatch.time(lambda: worlds.act(LIFT_STEPS, gripper_finger=-1.0, lift=1.0))
    native = worlds.native_step_s()
    worlds.act(1, gripper_finger=-1.0, lift=0.25)
    worlds.act(HOLD_STEPS, gripper_finger=-1.0)
    slip = (worlds.in_gripper() - held).norm(dim=-1)
    grip = forces.finger_force
    good = ((views.pos - start)[:, 2] > 0.1) & (grip.sum(-1) > GRIP_N) & (grip.amin(-1) > 1.0)
    print("object   held  of  median slip [mm]  grip of a finger [N]")
    for kind, name in enumerate(OBJECTS):
        mine, ok = views.kind == kind, good & (views.kind == kind)
        slipped, force = (float(x[ok].median()) if ok.any() else math.nan for x in (slip * 1e3, grip))
        print(f"{name:8} {int(ok.sum()):4} {int(mine.sum()):3} {slipped:17.1f} {force:21.1f}")
    batched = lifting / LIFT_STEPS / nworld
    print(f"lifting: {batched * 1e3:.2f} ms per world and control step, C MuJoCo {native * 1e3:.2f} ms")


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", type=int, default=250)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--device", default="cpu")
    args = parser.parse_args()
    run(args.worlds, args.seed, args.device)


if __name__ == "__main__":
    main()
