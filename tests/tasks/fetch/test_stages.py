"""What ends a stage of a fetch and what does not: tables of what a control step left behind."""

import math
from dataclasses import replace

import pytest
from fetch_steps import (
    ALIGN,
    CARRY,
    HALF_EXTENTS,
    ON_TABLE,
    PICK,
    PLACE,
    REACH,
    RETRACT,
    TABLE,
    TABLE_TOP,
    Left,
    end_step,
)

from spin_rl.deploy.fetch.numbers import RELEASE_PHASE
from spin_rl.tasks.common.episode import COLLISION, RUNNING, SUCCESS
from spin_rl.tasks.fetch.config import STAGES, FetchConfig
from spin_rl.tasks.fetch.state import FETCH_OUTCOMES

CFG = FetchConfig()
DROPPED = FETCH_OUTCOMES.index("dropped")
HARD, SOFT = CFG.hard_force_n + 1.0, CFG.hard_force_n - 1.0
ON_FLOOR = (0.3, 0.1, HALF_EXTENTS[2])
PLACED = Left(PLACE, at=ON_FLOOR, support=True, ready=True, phase=int(RELEASE_PHASE) + 1)


@pytest.mark.parametrize(
    ("change", "placed"),
    [
        ({}, True),
        ({"at": (0.3, 0.1, HALF_EXTENTS[0])}, True),  # it lies
        ({"velocity": (0.0, 0.03, 0.0)}, True),  # the solver never brings it to rest entirely
        ({"support": False}, False),
        ({"velocity": (0.1, 0.0, 0.0)}, False),
        ({"velocity": (0.0, 0.0, -0.1)}, False),
        ({"at": (0.3, 0.1, 0.2)}, False),  # on something that is not the floor
        ({"at": (0.0, 0.7, HALF_EXTENTS[2])}, False),
        ({"ready": False}, False),
        ({"phase": 3}, False),  # still in the hand
    ],
    ids=str,
)
def test_placed_is_at_rest_on_the_floor_near_the_start_and_let_go(device, change, placed):
    ended = end_step(CFG, [replace(PLACED, **change)], device)
    assert ended.outcome == [SUCCESS if placed else RUNNING]
    assert ended.record.placed.tolist() == [placed]


def test_touching_ends_driving_and_pushing_hard_ends_all_else(device):
    driving = (REACH, CARRY)
    for part, hard in ((None, SOFT), (None, HARD), ("gripper", SOFT), ("base", HARD)):
        lefts = [Left(stage, part=part, hard=hard) for stage in range(len(STAGES))]
        ended = end_step(CFG, lefts, device)
        hits = [part is not None if left.stage in driving else hard == HARD for left in lefts]
        assert ended.outcome == [COLLISION if hit else RUNNING for hit in hits], (part, hard)
        assert ended.stage == list(range(len(STAGES)))
    assert ended.record.cause(PICK) == "pick collision base"


@pytest.mark.parametrize(
    "left",
    [replace(PLACED, hard=HARD), Left(RETRACT, loose=2, fingers=(0.0, 0.0), hard=HARD)],
    ids=["placed", "dropped"],
)
def test_a_hard_hit_outranks_what_else_the_step_ends_with(device, left):
    assert end_step(CFG, [left], device).outcome == [COLLISION]
    assert end_step(CFG, [replace(left, hard=SOFT)], device).outcome != [COLLISION]


def test_scrapes_are_counted_while_carrying_alone(device):
    """In the other stages the object stands on the table or is put down: it shall touch the scene."""
    for support in (True, False):
        ended = end_step(CFG, [Left(stage, support=support) for stage in range(len(STAGES))], device)
        assert ended.scrapes == [int(support and stage == CARRY) for stage in range(len(STAGES))]


def beside(along, across, yaw):
    """A place over the table's centre, moved along the table's axes, as it lies when turned."""
    x = TABLE[0] + along * math.cos(yaw) - across * math.sin(yaw)
    y = TABLE[1] + along * math.sin(yaw) + across * math.cos(yaw)
    return x, y, ON_TABLE[2]


@pytest.mark.parametrize("turn", [0.0, 0.5, -0.5, 0.5 * math.pi, 2.5])
def test_a_drop_is_onto_the_table_as_it_is_turned(device, turn):
    """0.8 x 0.4 m: a place 0.3 m along it is on it, 0.3 m across it is not."""
    places = [(0.3, 0.0), (-0.38, 0.18), (0.3, -0.18), (0.0, 0.3), (0.0, -0.22), (0.42, 0.0)]
    dropped = Left(RETRACT, table_yaw=turn, loose=2, fingers=(0.0, 0.0))
    ended = end_step(CFG, [replace(dropped, at=beside(*place, turn)) for place in places], device)
    assert ended.outcome == [RUNNING] * 3 + [DROPPED] * 3
    assert ended.stage == [ALIGN] * 3 + [RETRACT] * 3
    assert ended.retries == [1] * 3 + [0] * 3
    again = end_step(CFG, [replace(dropped, at=beside(0.3, 0.0, turn), retries=CFG.retries)], device)
    assert again.outcome == [DROPPED], "no attempt is left"


@pytest.mark.parametrize("ready", [False, True])
@pytest.mark.parametrize("seen", [False, True])
def test_a_pick_begins_unfolded_and_with_the_object_in_sight(device, ready, seen):
    ended = end_step(CFG, [Left(ALIGN, ready=ready, seen=seen)], device)
    assert ended.outcome == [RUNNING] and ended.stage == [PICK if ready and seen else ALIGN]


@pytest.mark.parametrize("stage", [ALIGN, PICK])
def test_an_object_is_lost_when_its_centre_is_below_the_tables_top(device, stage):
    depths = [CFG.fall_m - 0.005, CFG.fall_m + 0.005]
    ended = end_step(CFG, [Left(stage, at=(2.0, 1.0, TABLE_TOP - depth)) for depth in depths], device)
    assert ended.outcome == [RUNNING, DROPPED]
