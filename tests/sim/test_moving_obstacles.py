"""Obstacles that move, in physics: the judge is C MuJoCo with models compiled for where they are."""

import mujoco
import numpy as np
import pytest
from sim_worlds import POOL, advance, restart, scene_with, simulate

from spin_rl.scenes.builder import native_model
from spin_rl.sim import simulation
from spin_rl.sim.config import SimConfig
from spin_rl.sim.graph import StepGraph

BOX, CYLINDER = POOL.first_box, POOL.first_cylinder


def crossing(slot, start, to, *, half_size=(0.1, 0.1, 0.1), speed=1.0, trigger=0.0):
    """A world in which one thing moves towards the standing robot."""
    scene = scene_with()
    scene.active[slot] = True
    scene.pos[slot] = start
    scene.half_size[slot] = half_size
    scene.home[slot] = (*to, start[2])
    scene.retreat[slot] = np.subtract(start[:2], to)
    scene.motion_speed[slot], scene.motion_trigger[slot] = speed, trigger
    return scene


def contact_depths(model, geoms, distances):
    """Deepest contact of each pair of geoms, by name."""
    depths = {}
    for pair, distance in zip(geoms, distances, strict=True):
        names = tuple(sorted(model.geom(int(geom)).name for geom in pair))
        if distance < 0.0:
            depths[names] = min(distance, depths.get(names, 0.0))
    return depths


def our_contacts(sim, world):
    contact, count = sim.data.contact, int(sim.data.nacon.numpy()[0])
    rows = np.flatnonzero(contact.worldid.numpy()[:count] == world)
    return contact_depths(sim.mj_model, contact.geom.numpy()[rows], contact.dist.numpy()[rows])


def native_contacts(scene, qpos):
    model = native_model(scene)
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    return contact_depths(model, data.contact.geom, data.contact.dist)


def test_contacts_are_those_of_native_models_at_the_moved_places(device):
    scenes = [
        crossing(BOX, (0.6, 0.1, 0.1), (0.1, 0.1)),
        crossing(BOX, (-0.1, 0.6, 1.0), (-0.1, 0.2), half_size=(0.1, 0.1, 0.2), speed=0.6),
        crossing(CYLINDER, (0.4, -0.4, 0.5), (0.0, -0.15), half_size=(0.08, 0.08, 0.5), trigger=0.5),
        crossing(CYLINDER, (0.4, -0.4, 0.5), (0.0, -0.15), half_size=(0.08, 0.08, 0.5), trigger=0.1),
    ]
    sim = simulate(scenes, device, SimConfig(substeps=1), moving=True)
    touched = np.zeros(len(scenes), dtype=int)
    for _ in range(32):
        qpos = sim.data.qpos.numpy().copy()
        advance(sim)
        for world in range(len(scenes)):
            ours, theirs = our_contacts(sim, world), native_contacts(sim.layout.scene(world), qpos[world])
            assert ours.keys() == theirs.keys(), (world, ours, theirs)
            for pair, depth in theirs.items():
                assert ours[pair] == pytest.approx(depth, abs=1e-3), (world, pair)
            touched[world] += bool(ours)
            assert sim.views.part_contacts[world].any().item() == bool(ours)
    assert (touched[:3] > 2).all() and touched[3] == 0


def test_a_graph_moves_them_like_eager_launches_and_a_reset_starts_them_anew(device):
    scenes = [crossing(BOX, (2.0, 1.0, 0.1), (2.0, 0.0), trigger=trigger) for trigger in (0.0, 3.0)]
    eager, captured = (simulate(scenes, device, moving=True) for _ in range(2))
    graph = StepGraph(captured.advance, device)
    first = eager.layout.pos.numpy().copy()
    for _ in range(4):
        advance(eager)
        graph.replay()
    later = eager.layout.pos.numpy().copy()
    assert later[0, BOX, 1] == pytest.approx(0.6, abs=1e-5) == later[1, BOX, 1]
    assert np.array_equal(later, captured.layout.pos.numpy())
    geom = eager.mj_model.geom("box_0").id
    assert np.array_equal(eager.data.geom_xpos.numpy()[:, geom], later[:, BOX])
    restart(eager)
    assert np.array_equal(eager.layout.pos.numpy(), first)
    assert np.array_equal(eager.data.geom_xpos.numpy()[:, geom], first[:, BOX])
    for _ in range(4):
        advance(eager)
    assert np.array_equal(eager.layout.pos.numpy(), later)


def test_nothing_is_launched_where_nothing_can_move(device, monkeypatch):
    calls = []
    for name in ("move_slots", "restart_motion"):
        monkeypatch.setattr(simulation, name, lambda *arguments, name=name: calls.append(name))
    for moving in (False, True):
        advance(simulate([scene_with()], device, moving=moving))
        assert set(calls) == ({"move_slots", "restart_motion"} if moving else set())


def test_standing_things_stay_while_others_move(device):
    scene = crossing(BOX, (2.0, 1.0, 0.1), (2.0, 0.0))
    scene.active[BOX + 1] = True
    scene.pos[BOX + 1] = (3.0, 0.0, 0.1)
    sim = simulate([scene], device, moving=True)
    before = sim.data.geom_xpos.numpy().copy()
    advance(sim)
    after = sim.data.geom_xpos.numpy()
    changed = (before != after).any(axis=-1)[0]
    still = [sim.mj_model.geom(name).id for name in POOL.geom_names() if name != "box_0"]
    assert changed[sim.mj_model.geom("box_0").id] and not changed[still].any()
    assert not sim.views.part_contacts.any()
