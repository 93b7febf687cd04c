# pyright: reportGeneralTypeIssues=false
# (to a type checker, a Warp struct is an object, not a class)
"""The stages of a fetch, and the arrays that say where each world's fetch is.

reach    the navigation policy drives to the table
align    scripted: find the object, fold the arm, drive and turn until the object is to the right, unfold
pick     the pick policy
retract  scripted: lift the object further, arm in, back to the middle of the corridor, fold the wrist
carry    the navigation policy drives back to the start
place    scripted: turn, unfold, lower, open, raise
"""

import warp as wp

from spin_rl import robot
from spin_rl.tasks.fetch.config import STAGES
from spin_rl.tasks.pick.episode import PICK_OUTCOMES
from spin_rl.warp_kernels.slots import Slots

REACH = wp.constant(STAGES.index("reach"))
ALIGN = wp.constant(STAGES.index("align"))
PICK = wp.constant(STAGES.index("pick"))
RETRACT = wp.constant(STAGES.index("retract"))
CARRY = wp.constant(STAGES.index("carry"))
PLACE = wp.constant(STAGES.index("place"))
FETCH_OUTCOMES = PICK_OUTCOMES


wp.set_module_options({"enable_backward": False})


@wp.struct
class FetchRules:
    """When stages end; see `FetchConfig`. `limits` are the steps of `StageLimits`.

    `must_see` asks that the object is in sight as the pick begins, which a head that is held cannot see to.
    """

    limits: wp.array[int]
    episode_steps: int
    retries: int
    hold_steps: int
    goal_tolerance_m: float
    home_tolerance_m: float
    lift_m: float
    grasp_force_n: float
    finger_force_n: float
    hard_force_n: float
    fall_m: float
    place_m: float
    table_slot: int
    must_see: bool


@wp.struct
class FetchState:
    """Where the running fetch of each world is, leading axis nworld.

    `time` and `length` count the steps of the stage and of the fetch, `phase` and `phase_time` are of the
    scripts. `home` is where the robot started, `stand` the goal at the table and the yaw at which it began to
    pick, `found` where the camera saw the object last, `rest` the object's height as the pick began, `grip`
    pitch and roll of the wrist as the object left the table, `mark` the lift at which a script began.
    `loose` counts steps without a grip, `stuck` those in which the base could not do what a script wanted,
    `detour` tells that it makes room first. `held` counts steps with the object up, `scrapes` those in which
    it touched the scene while it was carried.
    """

    stage: wp.array[int]
    time: wp.array[int]
    length: wp.array[int]
    phase: wp.array[int]
    phase_time: wp.array[int]
    ready: wp.array[wp.bool]
    held: wp.array[int]
    loose: wp.array[int]
    stuck: wp.array[int]
    detour: wp.array[wp.bool]
    retries: wp.array[int]
    drops: wp.array[int]
    scrapes: wp.array[int]
    reached: wp.array[wp.bool]
    picked: wp.array[wp.bool]
    stage_steps: wp.array2d[int]
    home: wp.array[wp.vec2]
    stand: wp.array[wp.vec3]
    found: wp.array[wp.vec3]
    is_found: wp.array[wp.bool]
    rest: wp.array[float]
    grip: wp.array[wp.vec2]
    mark: wp.array[float]


@wp.struct
class FetchRecord:
    """How the first fetch of each world after a reset from outside ended; see `FetchEpisodes`."""

    outcome: wp.array[int]
    stage: wp.array[int]
    kind: wp.array[int]
    steps: wp.array2d[int]
    reached: wp.array[wp.bool]
    picked: wp.array[wp.bool]
    retries: wp.array[int]
    drops: wp.array[int]
    scrapes: wp.array[int]
    distance: wp.array[float]
    parts: wp.array2d[wp.bool]


@wp.struct
class Bodies:
    """What the simulator knows of robot, object and scene, leading axis nworld."""

    qpos: wp.array2d[float]
    qvel: wp.array2d[float]
    parts: wp.array2d[wp.bool]
    target: wp.array2d[float]
    object_kind: wp.array[int]
    object_start: wp.array[wp.vec4]
    half_extents: wp.array[wp.vec3]
    goal: wp.array[wp.vec2]
    slots: Slots


def make_state(nworld: int, device: str) -> FetchState:
    """Allocate the state of a number of worlds."""
    state = FetchState()
    for name, var in FetchState.vars.items():
        shape = (nworld, len(STAGES)) if var.type.ndim == 2 else nworld
        setattr(state, name, wp.zeros(shape, dtype=var.type.dtype, device=device))
    return state


def make_record(nworld: int, device: str) -> FetchRecord:
    """Allocate the record of every world's first fetch."""
    record = FetchRecord()
    for name, var in FetchRecord.vars.items():
        shape = (nworld, len(robot.PARTS) if name == "parts" else len(STAGES))
        value = wp.zeros(shape if var.type.ndim == 2 else nworld, dtype=var.type.dtype, device=device)
        setattr(record, name, value)
    return record
