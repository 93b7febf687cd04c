"""The list of the slots nearest to the robot, against distances of plain NumPy."""

import numpy as np
import pytest
import warp as wp

from spin_rl.warp_kernels.nearby import REACH_M, find_nearby

NUM_SLOTS = 40


def random_slots(num_worlds, seed=0):
    rng = np.random.default_rng(seed)
    shape = (num_worlds, NUM_SLOTS)
    half = rng.uniform(0.03, 0.6, (*shape, 3))
    is_cylinder = np.arange(NUM_SLOTS) >= 30
    half[:, is_cylinder, 1] = half[:, is_cylinder, 0]
    return {
        "pos": rng.uniform(-4.0, 4.0, (*shape, 3)),
        "yaw": rng.uniform(-np.pi, np.pi, shape),
        "half_size": half,
        "active": rng.random(shape) < 0.8,
        "is_cylinder": is_cylinder,
        "qpos": rng.uniform(-2.0, 2.0, (num_worlds, 13)),
    }


def distances(slots, world):
    """From the base to every slot: to points all around the outline, which are 1 cm apart at most."""
    result = np.full(NUM_SLOTS, np.inf)
    base = slots["qpos"][world, :2]
    for slot in np.flatnonzero(slots["active"][world]):
        half, yaw = slots["half_size"][world, slot], slots["yaw"][world, slot]
        if slots["is_cylinder"][slot]:
            angle = np.linspace(0.0, 2.0 * np.pi, 400)
            outline = half[0] * np.stack([np.cos(angle), np.sin(angle)], -1)
        else:
            t = np.linspace(-1.0, 1.0, 200)
            one = np.ones_like(t)
            outline = np.concatenate(
                [np.stack(pair, -1) for pair in ((t, one), (t, -one), (one, t), (-one, t))]
            )
            outline = outline * half[:2]
        local = base - slots["pos"][world, slot, :2]
        cos, sin = np.cos(yaw), np.sin(yaw)
        local = np.array([cos * local[0] + sin * local[1], cos * local[1] - sin * local[0]])
        inside = (
            np.hypot(*local) < half[0] if slots["is_cylinder"][slot] else (np.abs(local) < half[:2]).all()
        )
        result[slot] = 0.0 if inside else np.linalg.norm(outline - local, axis=-1).min()
    return result


def run(slots, k, device):
    types = {"pos": wp.vec3, "half_size": wp.vec3, "active": bool, "is_cylinder": bool}
    arrays = {
        name: wp.array(value, dtype=types.get(name, float), device=device) for name, value in slots.items()
    }
    num_worlds = len(slots["qpos"])
    distance = wp.zeros((num_worlds, k), dtype=float, device=device)
    nearby = wp.zeros((num_worlds, k), dtype=wp.int32, device=device)
    missed = wp.zeros(1, dtype=wp.int32, device=device)
    find_nearby(**arrays, distance_out=distance, nearby_out=nearby, missed_out=missed)
    return distance.numpy(), nearby.numpy(), int(missed.numpy()[0])


@pytest.mark.parametrize("k", [1, 7, 24])
def test_the_nearest_are_listed_in_order(device, k):
    slots = random_slots(20, seed=k)
    distance, nearby, missed = run(slots, k, device)
    too_many = 0
    for world in range(20):
        expected = distances(slots, world)
        np.testing.assert_allclose(distance[world], np.sort(expected)[:k], atol=0.004)
        np.testing.assert_allclose(expected[nearby[world]], distance[world], atol=0.004)
        too_many += np.sort(expected)[k] < REACH_M
    assert missed == too_many
    assert k > 7 or missed > 0


def test_a_short_list_ends_with_none(device):
    slots = random_slots(3)
    slots["active"][0] = False
    slots["active"][1] = np.arange(NUM_SLOTS) == 5
    _, nearby, missed = run(slots, 12, device)
    assert (nearby[0] == -1).all()
    assert nearby[1].tolist() == [5] + [-1] * 11
    assert (nearby[2] >= 0).all()
    assert missed == 0 or slots["active"][2].sum() > 12
