import json

import pytest

from spin_rl.speed import rows as throughput
from spin_rl.speed.timing import Stopwatch, Subject, Timing, interleave


class FakeMachine:
    """A clock that work moves on, faster or slower as the machine drifts."""

    def __init__(self):
        self.now, self.slowness, self.log = 0.0, 1.0, []

    def work(self, name, seconds, slow_down=1.0):
        def run():
            self.log.append(name)
            self.now += seconds * self.slowness
            self.slowness *= slow_down

        return run


def measure(machine, seconds=100.0, **subjects):
    watch = Stopwatch(clock=lambda: machine.now)
    return interleave(
        {
            name: Subject(lambda n, run=run: watch.time(run, n), work)
            for name, (run, work) in subjects.items()
        },
        seconds,
        num_blocks=4,
    )


def test_timing_is_per_unit_of_work():
    machine = FakeMachine()
    times = measure(machine, fast=(machine.work("fast", 2.0), 8), slow=(machine.work("slow", 6.0), 4))
    assert times["fast"].blocks == pytest.approx([0.25] * 4)
    assert times["slow"].blocks == pytest.approx([1.5] * 4)
    row = throughput.rate_row("fast", times["fast"], "steps/s", "slow", times["slow"])
    assert (row.value, row.baseline_value, row.ratio) == pytest.approx((4.0, 1.0 / 1.5, 6.0))
    assert row.spread == pytest.approx((4.0, 4.0)) and row.baseline == "slow"
    cost = throughput.cost_row("slow", times["slow"], "us", "fast", times["fast"])
    assert (cost.value, cost.baseline_value, cost.ratio) == pytest.approx((1.5e6, 0.25e6, 1 / 6))


def test_drift_of_the_machine_cancels():
    machine = FakeMachine()
    # One call fills a block, and each makes the machine slower.
    times = measure(
        machine,
        seconds=8.0,
        a=(machine.work("a", 1.0, slow_down=1.2), 1),
        b=(machine.work("b", 3.0, slow_down=1.2), 1),
    )
    assert max(times["a"].blocks) > 2.0 * min(times["a"].blocks)
    assert times["a"].times_better_than(times["b"]) == pytest.approx(3.0, rel=0.03)


def test_subjects_take_turns_after_their_warm_up():
    machine = FakeMachine()
    measure(machine, seconds=8.0, a=(machine.work("a", 1.0), 1), b=(machine.work("b", 1.0), 1))
    assert "".join(machine.log) == "aabb" + "abbaabba"


def test_blocks_hold_as_many_calls_as_fit():
    machine = FakeMachine()
    measure(machine, seconds=80.0, a=(machine.work("a", 0.5), 1))
    assert len(machine.log) == 2 + 4 * 40


def test_ratio_needs_the_same_blocks():
    with pytest.raises(ValueError):
        Timing((1.0, 2.0)).times_better_than(Timing((1.0,)))


def test_rate_spread_is_low_to_high():
    row = throughput.rate_row("x", Timing((0.1, 0.5, 0.2)), "steps/s")
    assert row.spread == pytest.approx((2.0, 10.0)) and row.value == pytest.approx(5.0)
    assert row.ratio is None and row.baseline_value is None


def test_result_and_table():
    row = throughput.rate_row("env step", Timing((0.001,)), "steps/s", "bare", Timing((0.0005,)))
    result = json.loads(json.dumps(throughput.result("cpu", [row], num_envs=3)))
    assert result["device"] == "cpu" and result["settings"] == {"num_envs": 3}
    assert result["versions"]["mujoco"] and result["hardware"].endswith("cores, no GPU used")
    assert {"name", "value", "unit", "baseline", "ratio"} <= set(result["rows"][0])
    header, line = throughput.table([row]).splitlines()
    assert line.split() == "env step 1,000 1,000-1,000 steps/s 0.50x bare (2,000)".split()
    assert header.index("unit") == line.index("steps/s")
