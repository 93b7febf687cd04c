import numpy as np
import pytest
import torch

from spin_rl import robot
from spin_rl.analysis.hits import FLOOR, NearestObstacle
from spin_rl.tasks.nav.config import NavConfig

NUM_WORLDS = 12


@pytest.mark.parametrize("drive", [1.0, -1.0])
def test_the_nearest_is_what_physics_says_was_touched(make_nav_env, drive):
    # Episodes go on, so that the contact list is still there after the step.
    env = make_nav_env(NavConfig(stop_on_collision=False, difficulty=2), NUM_WORLDS)
    sim, nearest = env.sim, NearestObstacle(env.sim)
    nearest.remember_layouts()
    slots = {sim.mj_model.geom(name).id: slot for slot, name in enumerate(sim.layout.pool.geom_names())}
    slots[sim.mj_model.geom("floor").id] = FLOOR
    action = torch.zeros(NUM_WORLDS, len(robot.ACTIONS), device=env.device)
    action[:, 0] = drive
    action[: NUM_WORLDS // 2, robot.ACTIONS.index("arm_extension")] = 1.0
    action[: NUM_WORLDS // 2, robot.ACTIONS.index("wrist_yaw")] = -0.5
    checked = 0
    left = np.ones(NUM_WORLDS, dtype=bool)
    for _ in range(60):
        before, pos = sim.data.qpos.numpy().copy(), sim.layout.pos.numpy().copy()
        env.step(action)
        parts = sim.views.part_contacts.cpu().numpy()
        contact, count = sim.data.contact, int(sim.data.nacon.numpy()[0])
        geoms, worlds, depth = (
            array.numpy()[:count] for array in (contact.geom, contact.worldid, contact.dist)
        )
        for world in np.flatnonzero(left & parts.any(1)):
            left[world] = False
            touched = set()
            for pair in geoms[(worlds == world) & (depth < 0.0)]:
                names = [sim.mj_model.geom(geom).name.rstrip("0123456789").rstrip("_") for geom in pair]
                for i in (0, 1):
                    if names[i] in robot.PARTS and pair[1 - i] in slots:
                        touched.add((names[i], slots[pair[1 - i]]))
            for touch in nearest.find(int(world), pos[world], before[world], parts[world]):
                if touch.part in {part for part, _ in touched}:
                    assert (touch.part, touch.slot) in touched
                    checked += 1
    assert checked >= 5
