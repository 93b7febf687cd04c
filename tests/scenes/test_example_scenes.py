"""The example scenes and the furniture library: they load, lie where they should, and have ways through."""

import mujoco
import numpy as np
import pytest

from spin_rl.paths import CONF_DIR
from spin_rl.planning.lattice import reachable
from spin_rl.scenes.furniture import furniture_library
from spin_rl.scenes.scene_file import load_scene, parse_scene

HALF_SIDE_M = 6.0
RESOLUTION_M = 0.08  # of the search: twice the planner's own, four times as fast

# Per scene, places other than the goal that the robot should be able to drive to.
PLACES = {
    "apartment": {
        "bath": (-3.65, 2.2),
        "left of the bed": (-1.4, 1.4),
        "right of the bed": (0.7, 2.2),
        "child's room": (3.2, 2.4),
        "living room": (-2.0, -2.0),
        "end of the hall": (3.8, 0.0),
    },
    "cafe": {
        "behind the counter": (0.3, 2.95),
        "tables to stand at": (1.4, -2.9),
        "armchairs": (-3.3, -2.6),
        "between the tables": (0.1, -0.6),
        "west wall": (-4.0, 1.5),
        "plant": (4.0, 1.7),
    },
    "corridor": {},
    "lab": {
        "benches": (-1.7, 1.9),
        "robot cell": (2.3, 2.7),
        "desks": (0.4, -1.7),
        "cabinets": (-3.6, 1.2),
        "shelves": (3.6, -2.2),
        "behind the gantry": (1.8, 1.2),
    },
    "library": {
        "first aisle": (-4.2, 1.6),
        "third aisle": (-0.6, 1.4),
        "behind the shelves": (-2.0, 4.0),
        "carrels": (3.9, 2.3),
        "between the reading desks": (2.3, 1.4),
        "newspapers": (-2.7, -2.8),
        "information desk": (-0.4, -2.5),
    },
    "office": {
        "printer": (5.0, -3.6),
        "north window": (-3.2, 4.4),
        "south window": (-2.8, -4.3),
        "cabinets": (4.9, 0.6),
        "water cooler": (-0.3, 3.9),
        "behind the partition": (0.5, -3.0),
    },
    "playroom": {
        "shelves": (1.7, 1.65),
        "tent": (-1.4, -1.5),
        "wardrobe": (0.45, 1.35),
        "radiator": (0.6, -1.4),
        "middle": (1.1, -0.4),
    },
    "shop": {
        "first aisle": (0.3, 1.1),
        "second aisle": (0.0, -0.9),
        "freezers": (3.2, 3.3),
        "vegetables": (-3.0, -1.0),
        "between the checkouts": (-0.1, -4.2),
        "north shelves": (0.0, 3.3),
    },
    "study": {
        "kitchenette": (2.6, 2.8),
        "couch": (-3.6, 0.4),
        "whiteboard": (0.9, -3.4),
        "between the tables": (2.55, -1.9),
        "stools": (2.7, 0.6),
        "high table": (-0.9, 3.3),
    },
    "ward": {
        "west room": (-3.0, 2.4),
        "between the beds": (-3.0, 4.2),
        "chairs": (-1.5, -1.6),
        "east room": (4.2, 3.2),
        "end of the corridor": (5.4, -0.5),
    },
    "warehouse": {
        "racks": (-4.0, 3.4),
        "fork lift": (-1.6, -0.7),
        "packing": (4.3, -2.6),
        "drums": (4.5, 2.9),
        "roll cages": (4.5, -1.0),
        "pallets": (0.4, -4.3),
    },
    "workshop": {
        "benches": (-2.6, 2.2),
        "lathes": (-1.5, -2.2),
        "drills": (3.3, -2.4),
        "mill": (3.0, -0.4),
        "pallet": (1.2, 2.4),
        "cabinets": (-3.6, 1.2),
    },
}


def example(name):
    return load_scene(CONF_DIR / "scenes_examples" / f"{name}.yaml")


def test_every_example_has_its_places():
    files = sorted(file.stem for file in (CONF_DIR / "scenes_examples").glob("*.yaml"))
    assert files == sorted(PLACES)
    assert all(len(places) >= 5 for name, places in PLACES.items() if name != "corridor")


@pytest.mark.parametrize("name", PLACES)
def test_everything_lies_inside_the_square(name):
    scene = example(name)
    c, s = np.abs(np.cos(scene.yaw)), np.abs(np.sin(scene.yaw))
    half = scene.half_size
    reach = np.stack((c * half[:, 0] + s * half[:, 1], s * half[:, 0] + c * half[:, 1]), axis=1)
    assert (np.abs(scene.pos[:, :2]) + reach).max() <= HALF_SIDE_M + 1e-6
    assert (scene.pos[:, 2] - half[:, 2]).min() > -1e-6
    moves = scene.motion_speed > 0.0
    assert (np.abs(scene.home[moves, :2]) + reach[moves]).max(initial=0.0) <= HALF_SIDE_M


@pytest.mark.parametrize("name", PLACES)
def test_goal_and_places_can_be_reached(name):
    scene = example(name)
    places = {"goal": scene.goal, **PLACES[name]}
    found = reachable(scene, np.array(list(places.values())), RESOLUTION_M)
    assert not [place for place, is_found in zip(places, found, strict=True) if not is_found]


def test_no_way_leads_out_of_the_outer_walls():
    scene = example("study")
    assert reachable(scene, np.array([(0.0, 4.5), (4.3, 0.5)]), RESOLUTION_M).tolist() == [False, True]


def test_every_piece_of_the_library_can_be_placed():
    furniture = [{"piece": name, "position": [5.0, 5.0]} for name in furniture_library()]
    scene = parse_scene({"start": {"position": [0, 0]}, "goal": [1, 0], "furniture": furniture})
    assert scene.active.all()
    assert (scene.pos[:, 2] - scene.half_size[:, 2]).min() > -1e-6


def test_pieces_stand_where_mujoco_puts_a_body_with_their_parts():
    piece = {
        "boxes": [{"position": [0.3, -0.1, 0.5], "size": [0.2, 0.4, 0.1], "yaw": 0.4}],
        "cylinders": [{"position": [-0.2, 0.5], "radius": 0.1, "height": 0.6}],
    }
    placed = {"piece": "own", "position": [1.0, -2.0, 0.7], "yaw": 2.1}
    content = {"start": {"position": [0, 0]}, "goal": [4, 0], "pieces": {"own": piece}, "furniture": [placed]}
    scene = parse_scene(content)

    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(pos=placed["position"], quat=[np.cos(1.05), 0, 0, np.sin(1.05)])
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.1, 0.2, 0.05],
        pos=[0.3, -0.1, 0.5],
        quat=[np.cos(0.2), 0, 0, np.sin(0.2)],
    )
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[0.1, 0.3, 0], pos=[-0.2, 0.5, 0.3])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(scene.pos, data.geom_xpos, atol=1e-9)
    x_axis = data.geom_xmat[0].reshape(3, 3)[:2, 0]
    np.testing.assert_allclose((np.cos(scene.yaw[0]), np.sin(scene.yaw[0])), x_axis, atol=1e-9)
