"""Steps side by side: their order, what ends them, and two calls at a time."""

import math
import signal
import time

import pytest
from filelock import FileLock

from spin_rl.config import ConfigError
from spin_rl.reproduce import run, state
from spin_rl.reproduce.estimate import time_ahead
from spin_rl.reproduce.plan import read_steps

BOTH_HOLD = {"a-1": "holds", "a-2": "holds"}


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """Composes no configurations."""
    monkeypatch.setattr(state, "iterations", lambda arguments, env_steps: 1)


def when_begun(make_runner, runner, act):
    """Call `act` once in the loop of the runner, after two steps have begun and told something."""
    monotonic = time.monotonic

    def minutes_left():
        if len(make_runner.events()) == 2 and act:
            return act()
        assert monotonic() < give_up, runner.lines
        return math.inf

    give_up = monotonic() + 30.0
    runner._minutes_left = minutes_left


@pytest.mark.parametrize("jobs", [1, 2, 4])
def test_as_many_as_wanted_each_once_after_what_it_needs(make_runner, jobs):
    steps = make_runner.steps
    assert make_runner(jobs=jobs).run(make_runner.all)
    running, ended = set(), set()
    for what, name in make_runner.events():
        if what == "begin":
            assert ended.issuperset(steps.needs(steps.by_name[name])) and name not in running | ended
            running.add(name)
            assert len(running) <= jobs
        else:
            running.remove(name)
            ended.add(name)
    assert ended == set(steps.by_name)
    if jobs == 1:
        assert [name for what, name in make_runner.events() if what == "begin"] == list(steps.by_name)


def test_steps_run_side_by_side(make_runner):
    """Both hold until both have begun, and with room for more, what needs them does not begin."""
    runner = make_runner(BOTH_HOLD, jobs=4, minutes=5.0)
    when_begun(make_runner, runner, lambda: 0.0)
    assert not runner.run(make_runner.all)
    assert [tool for tool, _ in runner.calls] == ["train", "train"]
    assert runner.lines[-1] == "Stopped by minutes=5 in a-1, a-2"


@pytest.mark.parametrize("jobs", [1, 2, 4])
@pytest.mark.parametrize("needs", ["policy={a-2}", "policy=zero"])
def test_what_has_to_be_alone_is(make_runner, jobs, needs, tmp_path):
    quiet = {"kind": "quiet", "name": "a", "arguments": [needs], "alone": True}
    group = make_runner.plan["groups"][0] | {"evaluations": [quiet]}
    make_runner.steps = read_steps(make_runner.plan | {"groups": [group]}, tmp_path / "runs")
    steps = list(make_runner.steps.by_name.values())
    assert make_runner({"a-1": "slow"}, jobs=jobs).run(steps)
    events = make_runner.events()
    at = events.index(("begin", "quiet/a"))
    assert events[at + 1] == ("end", "quiet/a")
    before = [what for what, _ in events[:at]]
    assert before.count("begin") == before.count("end")
    assert at == 0 or needs == "policy={a-2}"  # where it may, it begins before anything else runs
    assert len(events) == 2 * len(steps)


def test_limit_of_time_saves_and_the_next_call_goes_on(make_runner):
    steps = make_runner.steps
    for samples in (40_000, 80_000):
        runner = make_runner(BOTH_HOLD, minutes=5.0)
        when_begun(make_runner, runner, lambda: 0.0)
        assert not runner.run(make_runner.all)
        assert {state.state_of(steps, steps.by_name[name]).env_steps for name in BOTH_HOLD} == {samples}
    runner = make_runner()
    assert runner.run(make_runner.all)
    assert [arguments[0] for tool, arguments in runner.calls if tool == "train"][:2] == [
        f"resume={steps.run_dir(name)}" for name in BOTH_HOLD
    ]
    assert all("max_minutes=null" in arguments for tool, arguments in runner.calls if tool == "train")


def test_part_of_a_measurement_is_no_result(make_runner):
    assert make_runner().run(make_runner.all[:2])
    evaluations = [step for step in make_runner.all if step.name.startswith("reach/")]
    runner = make_runner({step.name: "holds" for step in evaluations}, minutes=5.0)
    when_begun(make_runner, runner, lambda: 0.0)
    assert not runner.run(evaluations)
    assert [state.state_of(make_runner.steps, step).status for step in evaluations] == ["missing", "missing"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_is_passed_on_and_waited_for(make_runner, monkeypatch, number):
    monkeypatch.setattr(run, "_REPORT_S", 0.0)
    runner = make_runner(BOTH_HOLD)
    done = []

    def act():
        told = {line.split(":")[0] for line in runner.lines if line.startswith("  ")}
        if told == {"  a-1", "  a-2"} and not done:
            done.append(True)
            signal.raise_signal(number)
        return math.inf

    when_begun(make_runner, runner, act)
    with pytest.raises(KeyboardInterrupt):
        runner.run(make_runner.all)
    assert "  a-1: 0.040 M env steps | success 12.0%" in runner.lines
    assert [what for what, _ in make_runner.events()] == [
        "begin",
        "begin",
        "end",
        "end",
    ]  # nothing new, all saved
    assert {state.state_of(make_runner.steps, step).status for step in make_runner.all[:2]} == {"partial"}


def test_what_does_not_end_is_killed(make_runner, monkeypatch):
    monkeypatch.setattr(run, "_PATIENCE_S", 0.2)
    runner = make_runner({"a-1": "hangs", "a-2": "holds"}, minutes=5.0)
    when_begun(make_runner, runner, lambda: 0.0)
    assert not runner.run(make_runner.all)
    assert make_runner.events()[2:] == [("end", "a-2")]


def test_a_failure_holds_up_only_what_needs_it(make_runner):
    steps = make_runner.steps
    runner = make_runner({"a-1": "fails"})
    with pytest.raises(
        ConfigError, match=r"^run: a-1 ended with status 3, see .*a-1.log: .*it is broken$"
    ) as error:
        runner.run(make_runner.all)
    assert "\n" not in str(error.value)
    assert "  given up with it: b-1, reach/a-1" in runner.lines
    done = [step.name for step in make_runner.all if state.is_done(steps, step)]
    assert done == ["a-2", "reach/a-2"]
    assert make_runner().run(make_runner.all)  # what is left, once it is mended


def test_an_error_of_our_own_ends_all_in_order(make_runner, monkeypatch):
    steps = make_runner.steps
    make_runner().run([steps.by_name["a-1"]])
    runner = make_runner({"a-2": "holds"})
    give_up = time.monotonic() + 30.0

    def broken(*_):
        while ("begin", "a-2") not in make_runner.events() and time.monotonic() < give_up:
            time.sleep(0.01)
        raise OSError("disk full")

    monkeypatch.setattr(run, "stored", broken)
    with pytest.raises(OSError, match="disk full"):
        runner.run([steps.by_name["a-2"], steps.by_name["reach/a-1"]])
    assert state.state_of(steps, steps.by_name["a-2"]).status == "partial"


def test_two_calls_do_not_run_the_same_step(make_runner):
    steps = make_runner.steps
    with FileLock(steps.runs / "logs" / "a-1.lock"):
        runner = make_runner()
        with pytest.raises(ConfigError, match=r"^run: a-1 is run by another call of spin-reproduce$"):
            runner.run(make_runner.all)
    assert {name for _, name in make_runner.events()} == {"a-2", "reach/a-2"}
    assert make_runner().run(make_runner.all)


def test_what_another_call_has_done_meanwhile_is_not_done_again(make_runner):
    first, second = make_runner.all[:2]
    other = make_runner()
    assert other.run([first])
    runner = make_runner()
    assert runner._work([first, second])
    assert "a-1: done by another call of spin-reproduce" in runner.lines
    assert {name for _, name in make_runner.events()} == {"a-2"}


def test_a_run_with_other_arguments_than_planned_is_refused(make_runner):
    step = make_runner.all[0]
    assert make_runner().run([step])
    calls = state.calls_file(make_runner.steps.run_dir("a-1"))
    calls.write_text(calls.read_text().replace('"preset=cpu"]', '"preset=gpu"]', 1))
    assert state.state_of(make_runner.steps, step).status == "outdated"
    runner = make_runner()
    with pytest.raises(
        ConfigError, match=r"run: a-1 has a run with other arguments than planned; move .*a-1 away"
    ):
        runner.run([step])
    assert runner.calls == []


@pytest.mark.parametrize(
    ("minutes", "jobs", "expected"),
    [
        ({}, 2, 0.0),
        ({"a-1": 10.0, "a-2": 10.0, "b-1": 10.0}, 1, 30.0),
        ({"a-1": 10.0, "a-2": 10.0, "b-1": 10.0}, 2, 20.0),
        ({"a-1": 10.0, "b-1": 10.0}, 2, 20.0),  # one needs the other
        ({"a-2": 4.0, "reach/a-1": 5.0, "reach/a-2": 1.0}, 2, 5.0),
        ({"a-2": 4.0, "reach/a-2": 3.0}, 9, 7.0),
    ],
)
def test_time_ahead(make_runner, minutes, jobs, expected):
    assert time_ahead(make_runner.steps, minutes, jobs) == expected


def test_time_ahead_knows_what_has_to_be_alone(make_runner, tmp_path):
    quiet = {"kind": "quiet", "name": "a", "arguments": ["policy=zero"], "alone": True}
    group = make_runner.plan["groups"][0] | {"evaluations": [quiet]}
    steps = read_steps(make_runner.plan | {"groups": [group]}, tmp_path / "runs")
    minutes = {"a-1": 10.0, "a-2": 4.0, "quiet/a": 3.0, "reach/a-1": 2.0}
    assert time_ahead(steps, minutes, 2) == 15.0 and time_ahead(steps, minutes, 1) == 19.0
