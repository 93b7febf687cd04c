"""The plan of trainings and evaluations: what it holds, in which order, and what of it is done."""

import json

import pytest
from stored_results import MACHINE, rows_of

from spin_rl.cli import common, evaluate, measurement, train
from spin_rl.config import ConfigError
from spin_rl.reproduce import state
from spin_rl.reproduce.listing import progress
from spin_rl.reproduce.plan import Evaluation, Training, is_alone, read_steps
from spin_rl.reproduce.tables.stored import Stored
from spin_rl.runners.config import check_config
from spin_rl.tasks.common.compose import compose, with_depth
from spin_rl.tasks.registry import find_task

SHIPPED = read_steps(compose("reproduce")["plan"])
TRAININGS = [step for step in SHIPPED.by_name.values() if isinstance(step, Training)]
SMALL = {
    "budgets": {"drive": {"env_steps": 1000, "minutes": 10, "arguments": ["preset=cpu"]}},
    "groups": [
        {
            "name": "one",
            "claim": "two phases",
            "trainings": [
                {"name": "first", "seeds": [1, 2], "evaluate": False},
                {"name": "second", "seeds": [1, 2], "arguments": ["teacher={first}"]},
            ],
            "evaluations": [{"kind": "speed", "name": "env", "command": "bench", "arguments": ["what=env"]}],
        }
    ],
}


@pytest.fixture
def steps(tmp_path, monkeypatch):
    """The small plan, with runs and results in a folder of their own."""
    monkeypatch.setattr(state, "RESULT_DIR", tmp_path / "results")
    return read_steps(SMALL, tmp_path / "runs")


def begin(steps, name):
    """Leave behind what a training does that was killed."""
    folder = steps.run_dir(name)
    (folder / "checkpoints").mkdir(parents=True, exist_ok=True)
    (folder / "checkpoints" / "last.pt").touch()
    call = {"step": state.planned(steps.by_name[name]), "commit": "abc", "hardware": "a machine"}
    state.calls_file(folder).write_text(json.dumps(call) + "\n")


def finish(steps, name, env_steps=1000):
    """Leave behind what a training does."""
    begin(steps, name)
    folder = steps.run_dir(name)
    (folder / "summary.json").write_text(
        json.dumps({"env_steps": env_steps, "minutes": 3.5, "success_rate": 0.5})
    )


def described(steps, name):
    """What a result tells of a training by which it is known."""
    step = steps.by_name[name]
    facts = {"env_steps": 1000, "minutes": 3.5, "success_rate": 0.5}
    return state.planned(step) | facts | {"needs": [described(steps, other) for other in steps.needs(step)]}


def store(steps, name, **changes):
    """Keep a result."""
    step = steps.by_name[name]
    trainings = [described(steps, other) for other in steps.needs(step)]
    rows = rows_of(name.partition("/")[0], lambda cell: 50)
    kept = MACHINE | {"command": "spin-eval", "minutes": 2.0}
    kept |= {"result": {"rows": rows, "seeds": [0], "num_envs": 9, "commit": "abc"}}
    kept |= {"step": state.planned(step), "trainings": trainings} | changes
    file = state.result_file(name)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(kept))


@pytest.mark.parametrize("step", TRAININGS, ids=lambda step: step.name)
def test_every_training_of_the_shipped_plan_can_be_started(step):
    values = with_depth(compose("train", [*SHIPPED.arguments(step), f"seed={step.seed}"]))
    common.check_keys("train", values, common.keys_of(train.Options, common.GROUPS))
    spec = find_task(values["task"]["name"])
    task = spec.configure(values)
    check_config(values["runner"], spec.groups, values["num_envs"])
    assert task.sim.kinematic and task.curriculum.enabled and values["scene"]["width"] == 1.0


def test_all_methods_of_a_comparison_have_the_same_samples():
    budgets = {step.name: step.env_steps for step in TRAININGS}
    total = {
        step.name: step.env_steps + sum(budgets[name] for name in SHIPPED.needs(step)) for step in TRAININGS
    }
    others = {name: count for name, count in total.items() if not name.startswith(("dvo1a", "direct_depth"))}
    assert set(others.values()) == {8_000_000}


def test_iterations_give_at_least_the_samples():
    for name in ("cvo-1", "dvo-1", "direct_depth-1"):
        step = SHIPPED.by_name[name]
        per_iteration = 512 * 32
        count = int(state.limits(step)[0].removeprefix("max_iterations="))
        assert (count - 1) * per_iteration < step.env_steps <= count * per_iteration


def test_every_evaluation_names_a_command_that_composes():
    for step in SHIPPED.by_name.values():
        if isinstance(step, Evaluation):
            task = ["task=fetch"] if step.name.startswith("fetch/") else []  # as the command itself adds
            compose(step.command, [*task, *SHIPPED.arguments(step)])


@pytest.mark.parametrize("kind", ["dynamic", "fetch"])
def test_benchmarks_of_the_shipped_plan_have_their_episodes(kind):
    """As spin-eval itself reads them: 300 of every row with dynamic obstacles, 30 fetches of every cell."""
    for step in SHIPPED.by_name.values():
        if step.name.startswith(f"{kind}/"):
            task = ["task=fetch"] if kind == "fetch" else []
            given = [*task, *SHIPPED.arguments(step)]
            options = measurement.read_options(common.Call(compose("eval", given), given))
            assert options.benchmark.name == kind
            assert options.episodes * len(options.seeds) == {"dynamic": 300, "fetch": 30}[kind]


def test_trainings_come_before_what_needs_them_and_seeds_go_together(steps):
    assert list(steps.by_name) == [
        "first-1", "first-2", "second-1", "second-2", "reach/second-1", "reach/second-2", "speed/env"
    ]  # fmt: skip
    assert steps.needs(steps.by_name["second-2"]) == ["first-2"]
    assert steps.arguments(steps.by_name["second-2"]) == ["preset=cpu", f"teacher={steps.runs}/first-2"]


def test_only_takes_what_is_needed_too(steps):
    assert [step.name for step in steps.chosen(["reach/second-2"])] == [
        "first-2",
        "second-2",
        "reach/second-2",
    ]
    assert len(steps.chosen(None)) == 7
    with pytest.raises(ConfigError, match="only: no step has 'third'"):
        steps.chosen(["third"])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"trainings": [{"name": "a", "seeds": [1], "budget": "big"}]}, "unknown budget 'big'"),
        (
            {"trainings": [{"name": "a", "seeds": [1], "arguments": ["teacher={b}"]}]},
            "needs the training b-1",
        ),
        ({"trainings": [{"name": "a", "seeds": [1]}, {"name": "a", "seeds": [1]}]}, "a-1 is there twice"),
        ({"trainings": [{"name": "a"}]}, r"trainings\[0\].seeds: a value is needed"),
        ({"trainigs": []}, "trainigs: unknown key"),
    ],
)
def test_a_bad_plan_is_one_line(change, message):
    plan = SMALL | {"groups": [{"name": "g", "claim": "c"} | change]}
    with pytest.raises(ConfigError, match=message):
        read_steps(plan)


def test_states_of_a_training(steps):
    step = steps.by_name["first-1"]
    assert state.state_of(steps, step).status == "missing"
    (steps.run_dir("first-1") / "checkpoints").mkdir(parents=True)
    assert state.state_of(steps, step).status == "missing"  # nothing to go on from
    begin(steps, "first-1")
    assert state.state_of(steps, step).status == "partial"
    finish(steps, "first-1", env_steps=999)
    assert state.state_of(steps, step) == state.State("partial", 3.5, 999, 0.5)
    finish(steps, "first-1")
    assert state.is_done(steps, step)


def test_a_run_that_tells_nothing_of_itself_is_none_of_the_plans(steps):
    """Somebody else trained there, or its files are damaged: it is not measured, and named in a line."""
    step, folder = steps.by_name["first-1"], steps.run_dir("first-1")
    finish(steps, "first-1")
    state.calls_file(folder).unlink()
    assert state.state_of(steps, step).status == "outdated"
    for file, text in ((state.calls_file(folder), '{"step": '), (folder / "summary.json", "{}")):
        finish(steps, "first-1")
        file.write_text(text)
        with pytest.raises(ConfigError, match=rf"^{file} is damaged: move {folder} away"):
            state.state_of(steps, step)


def test_a_new_training_asks_for_new_measurements(steps):
    """Rows of one name are of one run; tables of what is stored do not care for runs."""
    evaluation = steps.by_name["reach/second-1"]
    store(steps, evaluation.name)
    finish(steps, "second-1")
    assert state.is_done(steps, evaluation)
    finish(steps, "second-1", env_steps=1001)
    assert state.state_of(steps, evaluation).status == "outdated"
    assert state.state_of_result(steps, evaluation).status == "done"


def test_trainings_whose_results_are_stored_are_not_needed_again(steps):
    store(steps, "reach/second-1")
    assert state.is_done(steps, steps.by_name["second-1"]) and state.is_done(steps, steps.by_name["first-1"])
    assert not state.is_done(steps, steps.by_name["second-2"])


def test_a_result_of_another_plan_is_outdated(steps):
    name = "reach/second-1"
    step = steps.by_name[name]
    assert state.state_of(steps, step).status == "missing"
    store(steps, name)
    assert state.state_of(steps, step).status == "done"
    store(steps, name, step=state.planned(step) | {"arguments": ["policy=zero"]})
    assert state.state_of(steps, step).status == "outdated"
    training = described(steps, "second-1")
    first = training["needs"][0]
    for other in (
        training | {"planned_env_steps": 500},
        training | {"needs": [first | {"seed": 9}]},
        training | {"needs": []},
    ):
        store(steps, name, trainings=[other])
        assert state.state_of(steps, step).status == "outdated"
    assert not state.is_done(steps, steps.by_name["first-1"])


def test_list_tells_states_and_the_time_that_is_left(steps):
    finish(steps, "first-1")
    finish(steps, "first-2", env_steps=500)
    lines = progress(steps, list(steps.by_name.values()), 1).splitlines()
    assert lines[1] == "one: two phases"
    assert lines[2].split()[:5] == ["first-1", "done", "0.00", "M", "3.5"]
    assert lines[3].split()[:2] == ["first-2", "partial"]
    # Half of the second training, two more, and three evaluations of four minutes.
    assert lines[-1] == "1 of 7 steps done; about 37 min left, 1 at a time"


def test_a_group_may_be_measured_in_another_way(tmp_path, monkeypatch):
    monkeypatch.setattr(state, "RESULT_DIR", tmp_path)
    measure = {"kind": "places", "arguments": ["benchmark=rooms", "scene=room"], "minutes": 7}
    group = {"name": "g", "claim": "c", "measure": measure, "trainings": [{"name": "a", "seeds": [1]}]}
    steps = read_steps(SMALL | {"name": "other", "groups": [group]}, tmp_path)
    step = steps.by_name["places/a-1"]
    assert isinstance(step, Evaluation) and step.minutes == 7
    assert steps.arguments(step) == [f"policy={tmp_path}/a-1", "benchmark=rooms", "scene=room"]
    with pytest.raises(ConfigError, match=r"spin-reproduce plan=other run=true only=places/a-1$"):
        Stored(steps, "t").of_trainings("places", "a")


def test_only_the_evaluation_of_speed_is_alone():
    assert [step.name for step in SHIPPED.by_name.values() if is_alone(step)] == ["speed/images"]


def test_tables_take_no_other_settings(monkeypatch, capfd):
    for arguments, expected in (
        (["table=2"], "table: unknown '2'"),
        (["table=1", "seeds=[0]"], "seeds: table=1 is of stored results"),
        (["table=1", "out=a.pdf"], "out: table=1 is written to .md or .csv"),
        (["table=1", "fresh=maybe"], "fresh: expected true or false"),
    ):
        monkeypatch.setattr("sys.argv", ["spin-eval", *arguments])
        with pytest.raises(SystemExit):
            evaluate.main()
        assert capfd.readouterr().err.startswith(f"spin-eval: error: {expected}")
