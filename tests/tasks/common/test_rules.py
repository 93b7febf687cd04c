"""Rules of a task in its kernels: those of the configuration, by name."""

from dataclasses import dataclass, replace

import pytest
import warp as wp

from spin_rl.tasks.common.config import TaskConfig
from spin_rl.tasks.common.rules import rules_of
from spin_rl.tasks.fetch.config import FetchConfig
from spin_rl.tasks.fetch.state import FetchRules
from spin_rl.tasks.nav.config import NavConfig
from spin_rl.tasks.nav.episode import NavRules
from spin_rl.tasks.pick.config import PickConfig
from spin_rl.tasks.pick.episode import PickRules


@dataclass(frozen=True)
class LiftConfig(TaskConfig):
    hold_s: float = 1.0
    lift_m: float = 0.25
    pair: tuple[float, float] = (1.0, 2.0)


@wp.struct
class LiftRules:
    hold_steps: int
    lift_m: float
    pair: wp.vec2
    table_slot: int


@pytest.mark.parametrize(("seconds", "steps"), [(1.0, 10), (0.26, 3), (0.24, 2), (0.01, 1)])
def test_times_become_steps_and_the_rest_is_taken_by_name(seconds, steps):
    rules = rules_of(LiftRules, LiftConfig(hold_s=seconds), table_slot=7)
    assert (rules.hold_steps, rules.lift_m, rules.table_slot) == (steps, 0.25, 7)
    assert tuple(rules.pair) == (1.0, 2.0)


def test_a_field_without_a_value_and_a_value_without_a_field_are_errors():
    with pytest.raises(AttributeError, match="table_slot"):
        rules_of(LiftRules, LiftConfig())
    with pytest.raises(TypeError, match="LiftRules has no field lift_n"):
        rules_of(LiftRules, LiftConfig(), table_slot=7, lift_n=1.0)


LEVELS = {"level_up": 0.1, "level_down": 0.2}
FETCH = {"limits": wp.zeros(6, dtype=wp.int32, device="cpu"), "table_slot": 1, "must_see": True}


@pytest.mark.parametrize(
    ("kind", "cfg", "others"),
    [
        (NavRules, NavConfig(), LEVELS),
        (PickRules, PickConfig(), LEVELS),
        (FetchRules, FetchConfig(), FETCH),
    ],
    ids=["nav", "pick", "fetch"],
)
def test_every_number_with_a_unit_counts_and_must_be_positive(kind, cfg, others):
    """A longer length, force or time shows in the field of its name, and in no other; none may be 0."""
    usual = rules_of(kind, cfg, **others)
    names = [name for name in kind.vars if name not in others]
    for name in names:
        key = name.removesuffix("teps") if name.endswith("_steps") else name
        value = getattr(cfg, key)
        other_value = not value if isinstance(value, bool) else 2 * value
        rules = rules_of(kind, replace(cfg, **{key: other_value}), **others)
        changed = [other for other in names if getattr(rules, other) != getattr(usual, other)]
        assert changed == [name]
        if key[-2:] in ("_m", "_s", "_n"):
            with pytest.raises(ValueError, match=rf"task\.{key} must "):
                replace(cfg, **{key: 0.0})
