"""Which object every world gets."""

import pytest
import warp as wp

from spin_rl.scenes.objects.shapes import OBJECTS
from spin_rl.tasks.common.objects.choice import ObjectChoice
from spin_rl.tasks.common.objects.config import check_object


@pytest.mark.parametrize(
    ("choice", "kinds"),
    [
        ("any", [-1] * 5),
        ("can", [OBJECTS.index("can")] * 5),
        ("mug+any", [OBJECTS.index("mug"), -1, OBJECTS.index("mug"), -1, OBJECTS.index("mug")]),
    ],
)
def test_names_are_given_to_the_worlds_in_turn(device, choice, kinds):
    check_object(choice)
    worlds = ObjectChoice()
    with wp.ScopedDevice(device):
        worlds._allocate_choice(5, choice)
    assert worlds._kind_choice.numpy().tolist() == kinds


@pytest.mark.parametrize("choice", ["cup", "can+cup", "can+", ""])
def test_a_name_that_is_none_is_refused(choice):
    with pytest.raises(ValueError, match=r"task\.object must be any or one of banana, .*, got '(cup|)'"):
        check_object(choice)
