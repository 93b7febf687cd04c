"""Sums of contact forces, from hand-written contact lists."""

import numpy as np
import pytest
import warp as wp

from spin_rl.warp_kernels import grasp
from spin_rl.warp_kernels.grasp import FINGER, HARD_PART, LEFT_PAD, NUM_SUMS, OBJECT, RIGHT_PAD, SCENE

ROLES = [0, LEFT_PAD, LEFT_PAD, RIGHT_PAD, FINGER, HARD_PART, SCENE, SCENE, OBJECT]
NONE, LEFT, LEFT_2, RIGHT, THIN, ARM, TABLE, FLOOR, CAN = range(len(ROLES))
FORCES = np.arange(1.0, 13.0).reshape(2, 6)

# Geoms and force row of a contact in world 1; finger forces, table force, hard contact, support after it.
CASES = {
    "left": ((LEFT, CAN), 1, [8, 0], 0, 0, False),
    "object_first": ((CAN, LEFT_2), 2, [9, 0], 0, 0, False),
    "right": ((RIGHT, CAN), 0, [0, 7], 0, 0, False),
    "pad_on_table": ((TABLE, RIGHT), 3, [0, 0], 10, 0, False),
    "finger_on_floor": ((THIN, FLOOR), 3, [0, 0], 10, 0, False),
    "arm_on_table": ((TABLE, ARM), 5, [0, 0], 0, 12, False),
    "object_on_table": ((TABLE, CAN), 4, [0, 0], 0, 0, True),
    "arm_on_object": ((ARM, CAN), 4, [0, 0], 0, 0, False),
    "pads_together": ((LEFT, RIGHT), 4, [0, 0], 0, 0, False),
    "no_role": ((NONE, TABLE), 4, [0, 0], 0, 0, False),
    "no_row": ((LEFT, CAN), -1, [0, 0], 0, 0, False),
    "row_beyond": ((LEFT, CAN), 6, [0, 0], 0, 0, False),
}


class Lists:
    """Contact lists of two worlds and the outputs; every output of world 0 is of the contact (ARM, FLOOR)."""

    def __init__(self, contacts, device, kind=1):
        entries = [((ARM, FLOOR), 0, 0, 1), *((geoms, row, 1, kind) for geoms, row in contacts)]
        self.count = len(entries)
        # A stale entry follows the last one in use.
        entries.append(((LEFT, CAN), 5, 1, 1))

        def array(column, dtype):
            return wp.array([entry[column] for entry in entries], dtype=dtype, device=device)

        self.geom, self.world, self.type = array(0, wp.vec2i), array(2, int), array(3, int)
        rows = np.full((len(entries), 4), 3, dtype=np.int32)
        rows[:, 0] = [entry[1] for entry in entries]
        self.rows = wp.array(rows, dtype=int, device=device)
        self.num = wp.array([self.count], dtype=int, device=device)
        self.force = wp.array(FORCES, dtype=float, device=device)
        self.roles = wp.array([int(role) for role in ROLES], dtype=int, device=device)
        self.sums = wp.zeros((2, NUM_SUMS), dtype=float, device=device)
        self.finger = wp.full((2, 2), 99.0, dtype=float, device=device)
        self.table, self.hard = (wp.zeros(2, dtype=float, device=device) for _ in range(2))
        self.support = wp.full((2,), True, dtype=wp.bool, device=device)

    def launch(self):
        grasp.grasp_forces(
            self.geom, self.world, self.type, self.rows, self.num, self.force, self.roles, self.sums,
            finger_out=self.finger, table_out=self.table, hard_out=self.hard, support_out=self.support,
        )  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_contact_belongs_to_its_sum_and_world(case, device):
    geoms, row, finger, table, hard, support = CASES[case]
    lists = Lists([(geoms, row)], device)
    lists.launch()
    np.testing.assert_array_equal(lists.finger.numpy(), [[0, 0], finger])
    np.testing.assert_array_equal(lists.table.numpy(), [0, table])
    np.testing.assert_array_equal(lists.hard.numpy(), [1, hard])
    np.testing.assert_array_equal(lists.support.numpy(), [False, support])


def test_contacts_of_one_sum_add_up(device):
    lists = Lists([((LEFT, CAN), 0), ((LEFT_2, CAN), 1), ((TABLE, THIN), 2), ((LEFT, TABLE), 3)], device)
    lists.launch()
    np.testing.assert_array_equal(lists.finger.numpy()[1], [7 + 8, 0])
    assert lists.table.numpy()[1] == 9 + 10


def test_other_kinds_of_contact_do_not_count(device):
    lists = Lists([((LEFT, CAN), 0)], device, kind=2)
    lists.launch()
    assert not lists.finger.numpy().any()


def test_substeps_keep_the_last_grip_and_the_hardest_blow(device):
    lists = Lists([((LEFT, CAN), 0), ((THIN, TABLE), 1), ((TABLE, CAN), 2)], device)
    lists.launch()
    with wp.ScopedCapture(device=device) as capture:
        lists.launch()
    lists.force.assign(0.5 * FORCES)
    wp.capture_launch(capture.graph)
    np.testing.assert_array_equal(lists.finger.numpy()[1], [3.5, 0])
    np.testing.assert_array_equal(lists.table.numpy(), [0, 8])
    np.testing.assert_array_equal(lists.hard.numpy(), [1, 0])
    assert lists.support.numpy()[1]
    lists.force.assign(2.0 * FORCES)
    lists.num.fill_(3)  # the object is lifted off the table
    wp.capture_launch(capture.graph)
    np.testing.assert_array_equal(lists.finger.numpy()[1], [14, 0])
    np.testing.assert_array_equal(lists.table.numpy(), [0, 16])
    np.testing.assert_array_equal(lists.hard.numpy(), [2, 0])
    assert not lists.support.numpy().any()
