"""Running the plan, with processes that do what trainings and evaluations leave behind."""

import importlib.util
import json
import shutil

import pytest

from spin_rl.cli import reproduce
from spin_rl.config import ConfigError
from spin_rl.reproduce import child, state
from spin_rl.reproduce.curve import POINTS, shorten
from spin_rl.reproduce.plan import read_steps
from spin_rl.reproduce.record import note_call


def test_runs_what_is_missing_once(make_runner):
    steps = make_runner.steps
    runner = make_runner()
    assert runner.run(make_runner.all)
    assert sorted(tool for tool, _ in runner.calls) == ["eval", "eval", "train", "train", "train"]
    # 100,000 samples of 256 worlds and 32 steps take 13 iterations.
    assert "max_iterations=13" in runner.calls[0][1]
    assert runner.lines[0].startswith("a-1: about 10 min; ") and runner.lines[0].endswith("/logs/a-1.log")
    assert sum("done after" in line for line in runner.lines) == 5
    kept = state.read_result("reach/a-2")
    assert kept["result"]["policy"] == str(steps.run_dir("a-2")) and kept["trainings"][0]["seed"] == 2
    assert kept["trainings"][0]["env_steps"] == 100_000 and kept["hardware"]
    again = make_runner()
    assert again.run(make_runner.all) and again.calls == []


def test_nothing_begins_without_time(make_runner):
    runner = make_runner(minutes=0.5)
    assert not runner.run([make_runner.steps.by_name["a-1"]]) and runner.calls == []
    assert "Stopped by minutes=0.5 before a-1" in runner.lines[0]


def test_an_evaluation_begins_only_if_it_can_end(make_runner):
    steps = make_runner.steps
    assert make_runner().run([steps.by_name["a-1"]])
    runner = make_runner(minutes=2.0)  # it takes three
    assert not runner.run([steps.by_name["reach/a-1"]]) and runner.calls == []


def test_measuring_again_needs_the_runs(make_runner):
    steps = make_runner.steps
    step = steps.by_name["reach/a-1"]
    needed = "^fresh: reach/a-1 needs .*a-1, whole and as planned: spin-reproduce run=true again=true only="
    with pytest.raises(ConfigError, match=needed):
        make_runner().measure_again([step])
    half = {"env_steps": 50_000, "minutes": 1.0, "success_rate": 0.5, "processes": 1}
    (steps.run_dir("a-1") / "checkpoints").mkdir(parents=True)
    (steps.run_dir("a-1") / "checkpoints" / "last.pt").touch()
    note_call(steps, steps.by_name["a-1"], [])
    for summary in (None, half):  # killed, or cut off
        if summary is not None:
            (steps.run_dir("a-1") / "summary.json").write_text(json.dumps(summary))
        with pytest.raises(ConfigError, match=needed):
            make_runner().measure_again([step])
    make_runner().run([steps.by_name["a-1"], step])
    state.result_file("reach/a-1").write_text("{}")
    runner = make_runner()
    runner.measure_again([step])
    assert state.is_done(steps, step) and [tool for tool, _ in runner.calls] == ["eval"]
    assert make_runner().run([step])
    runner = make_runner()
    runner.measure_again([step])  # also what is whole
    assert [tool for tool, _ in runner.calls] == ["eval"]


def test_a_row_again_from_results_alone_and_into_another_folder(make_runner, tmp_path):
    """In a fresh clone results are there and runs are not."""
    names = ("a-2", "reach/a-2")
    make_runner().run([make_runner.steps.by_name[name] for name in names])
    make_runner.steps = read_steps(make_runner.plan, tmp_path / "mine")
    chosen = make_runner.steps.chosen(["reach/a-2"])
    assert [step.name for step in chosen] == list(names)
    assert all(state.is_done(make_runner.steps, step) for step in chosen)
    for tools in (["train", "eval"], ["eval"]):  # then the run is there
        runner = make_runner()
        assert runner.run_again(chosen)
        assert [tool for tool, _ in runner.calls] == tools
    kept = state.read_result("reach/a-2")
    assert kept["result"]["policy"] == str(tmp_path / "mine" / "a-2")


def test_a_training_that_fails_is_not_done_by_a_result_of_before(make_runner, tmp_path):
    make_runner().run(make_runner.all)
    make_runner.steps = read_steps(make_runner.plan, tmp_path / "mine")
    runner = make_runner({"a-2": "fails"})
    with pytest.raises(ConfigError, match=r"^run: a-2 ended with status 3, see .*a-2.log"):
        runner.run_again(make_runner.steps.chosen(["reach/a-2"]))
    assert [tool for tool, _ in runner.calls] == ["train"]


def test_what_a_run_was_started_from_may_be_gone(make_runner):
    group = make_runner.plan["groups"][0]
    trainings = [dict(entry) for entry in group["trainings"]]
    trainings[1].pop("evaluate")
    make_runner.steps = read_steps(
        make_runner.plan | {"groups": [group | {"trainings": trainings}]}, make_runner.steps.runs
    )
    steps = make_runner.steps
    make_runner().run([steps.by_name[name] for name in ("a-1", "b-1", "reach/a-1")])
    shutil.rmtree(steps.run_dir("a-1"))
    note_call(steps, steps.by_name["b-1"], ["resume=here"])  # as where it goes on
    runner = make_runner()
    assert runner.run([steps.by_name["reach/b-1"]])
    (made,) = state.read_result("reach/b-1")["trainings"]
    assert [needed["name"] for needed in made["needs"]] == ["a-1"] and made["needs"][0][
        "env_steps"
    ] == 100_000


def test_commands_that_are_told_are_those_that_are_run(make_runner):
    runner = make_runner()
    assert runner.run(make_runner.all)
    told = [state.command_of(make_runner.steps, step).split() for step in make_runner.all]
    ran = [[f"spin-{tool}", *(a for a in given if not a.startswith("out="))] for tool, given in runner.calls]
    assert sorted(told) == sorted(ran)


def test_the_commands_that_are_run_exist():
    for tool in ("train", "eval", "bench"):
        command = child.python(tool, ["a=1"])
        assert importlib.util.find_spec(command[2]) and command[3:] == ["a=1"]


def test_curves_are_short_and_leave_out_what_is_unknown():
    count = 5 * POINTS
    values = [float("nan")] * 5 + [1.0] * (count - 5)
    curve = shorten([float(i) for i in range(count)], {"success_rate": values})
    assert len(curve["env_steps"]) == POINTS - 1 and set(curve["success_rate"]) == {1.0}
    assert curve["env_steps"][-1] == count - 1
    assert shorten([1.0], {"success_rate": [0.5]}) == {"env_steps": [1.0], "success_rate": [0.5]}


def test_list_is_what_happens_without_run(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["spin-reproduce", "only=fixcam_III"])
    reproduce.main()
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[2:6]] == [
        "fixcam_III-1", "fixcam_III-2", "reach/fixcam_III-1", "reach/fixcam_III-2"
    ]  # fmt: skip
    assert "of 4 steps done" in lines[6] and lines[7] == "run=true runs what is missing"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["only=nothing"], "only: no step has 'nothing'"),
        (["only=[]"], "only: expected a step"),
        (["only=[cvo,0.5]"], "only"),
        (["jobs=0"], "jobs: expected"),
        (["minutes=-1"], "minutes: expected"),
        (["plan.budgets.drive.env_steps=0"], "plan.budgets.drive.env_steps: expected"),
        (["runs=3"], "runs: expected a path"),
    ],
)
def test_bad_input_is_one_line(monkeypatch, capfd, arguments, expected):
    monkeypatch.setattr("sys.argv", ["spin-reproduce", *arguments])
    with pytest.raises(SystemExit) as stopped:
        reproduce.main()
    error = capfd.readouterr().err.strip()
    assert stopped.value.code == 2 and expected in error and "\n" not in error
