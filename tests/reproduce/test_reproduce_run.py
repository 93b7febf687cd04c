"""Running the plan, with processes that do what trainings and evaluations leave behind."""

import json
import signal
import subprocess
import sys
import textwrap
import time

import pytest

from spin_rl.cli import reproduce
from spin_rl.config import ConfigError
from spin_rl.reproduce import run, state
from spin_rl.reproduce.curve import POINTS, shorten
from spin_rl.reproduce.plan import read_steps

PLAN = {
    "budgets": {"drive": {"env_steps": 100_000, "minutes": 10, "arguments": ["preset=cpu"]}},
    "groups": [{"name": "one", "claim": "c", "trainings": [{"name": "a", "seeds": [1, 2]}]}],
}
# Trains by 40,000 samples a call, or all of them where there is time; measures; or fails.
FAKE = textwrap.dedent("""
    import json, pathlib, sys
    tool, *arguments = sys.argv[1:]
    given = dict(argument.split("=", 1) for argument in arguments)
    if "seed" in given and given["seed"] == "2" and {fails}:
        sys.exit(3)
    if "train" in tool:
        folder = pathlib.Path(given.get("resume") or given["run_dir"])
        before = folder / "summary.json"
        steps = json.loads(before.read_text())["env_steps"] if before.exists() else 0
        steps += 100_000 if given["max_minutes"] == "null" else 40_000
        (folder / "checkpoints").mkdir(parents=True, exist_ok=True)
        (folder / "checkpoints" / "last.pt").touch()
        facts = dict(env_steps=steps, minutes=1.0, success_rate=0.5, processes=1)
        before.write_text(json.dumps(facts))
    else:
        result = dict(rows=[dict(success_rate=0.5, episodes=2)], device="cpu", policy=given["policy"])
        pathlib.Path(given["out"]).write_text(json.dumps(result))
""")


@pytest.fixture
def make_runner(tmp_path, monkeypatch):
    """Makes a runner whose processes are fakes; its calls are in `calls`."""
    monkeypatch.setattr(state, "RESULT_DIR", tmp_path / "results")
    monkeypatch.setattr(run, "read_curve", lambda folder: {})
    steps = read_steps(PLAN, tmp_path / "runs")

    def make(fails=False, plan=None, **options):
        script = tmp_path / "fake.py"
        script.write_text(FAKE.format(fails=fails))
        given = steps if plan is None else read_steps(plan, tmp_path / "runs")
        runner = run.Runner(given, 2, report=lambda line: runner.lines.append(line), **options)
        runner.lines, runner.calls = [], []

        def python(tool, arguments, processes=1):
            runner.calls.append((tool, list(arguments), processes))
            return [sys.executable, str(script), tool, *arguments]

        monkeypatch.setattr(run, "_python", python)
        return runner

    make.steps = steps
    return make


def test_runs_what_is_missing_once(make_runner):
    steps = make_runner.steps
    runner = make_runner()
    assert runner.run(list(steps.by_name.values()))
    assert [tool for tool, _, _ in runner.calls] == ["train", "train", "eval", "eval"]
    # 100,000 samples of 256 worlds, 32 steps and 2 processes take 7 iterations.
    assert "max_iterations=7" in runner.calls[0][1] and runner.calls[0][2] == 2
    assert "reach/a-1, reach/a-2: about 3 min" in runner.lines[4]  # side by side
    kept = state.read_result("reach/a-2")
    assert kept["result"]["policy"] == str(steps.run_dir("a-2")) and kept["trainings"][0]["seed"] == 2
    assert kept["trainings"][0]["env_steps"] == 100_000 and kept["hardware"]
    again = make_runner()
    assert again.run(list(steps.by_name.values())) and again.calls == []


def test_goes_on_with_a_training_that_was_cut_off(make_runner):
    step = make_runner.steps.by_name["a-1"]
    for calls in range(2):
        runner = make_runner(minutes=5.0)
        assert not runner.run([step]) and "Stopped by minutes=5 in a-1" in runner.lines[-1]
        fresh = [argument for argument in runner.calls[0][1] if argument.startswith("run_dir=")]
        assert bool(fresh) == (calls == 0)
    assert f"resume={make_runner.steps.run_dir('a-1')}" in runner.calls[0][1]
    assert make_runner(minutes=5.0).run([step])
    calls = (make_runner.steps.run_dir("a-1") / "calls.jsonl").read_text().splitlines()
    assert len(calls) == 3 and "hardware" in json.loads(calls[0])


def test_trainings_of_one_process_run_side_by_side(make_runner):
    trainings = [
        {"name": "a", "seeds": [1, 2, 3], "evaluate": False},
        {"name": "b", "seeds": [3], "arguments": ["teacher={a}"]},
    ]
    plan = PLAN | {"processes": 1, "groups": [{"name": "one", "claim": "c", "trainings": trainings}]}
    runner = make_runner(plan=plan)
    assert runner.run(list(runner.steps.by_name.values()))
    # The last one learns from the one before it, which must be done.
    assert [line.split(":")[0] for line in runner.lines[::2]] == ["a-1, a-2", "a-3", "b-3", "reach/b-3"]
    # 100,000 samples of 256 worlds, 32 steps and one process take 13 iterations.
    assert all("max_iterations=13" in arguments and count == 1 for _, arguments, count in runner.calls[:4])
    assert (runner.steps.runs / "logs" / "a-2.log").exists()
    assert not (runner.steps.runs / "logs" / "a-3.log").exists()  # alone, it writes to the terminal
    assert "about 22 min for all that is left" in runner.lines[0]  # 10 of each training, 2 side by side


def test_a_failure_among_several_trainings_names_its_log(make_runner):
    runner = make_runner(fails=True, plan=PLAN | {"processes": 1})
    with pytest.raises(ConfigError, match=r"run: a-2 \(see .*logs/a-2.log\) ended with status 3"):
        runner.run(list(runner.steps.by_name.values()))
    assert state.is_done(runner.steps, runner.steps.by_name["a-1"])


def test_nothing_begins_without_time(make_runner):
    runner = make_runner(minutes=0.5)
    assert not runner.run([make_runner.steps.by_name["a-1"]]) and runner.calls == []
    assert "Stopped by minutes=0.5 before a-1" in runner.lines[0]


def test_a_failure_is_one_line_that_names_the_step(make_runner):
    with pytest.raises(ConfigError, match="run: a-2 ended with status 3"):
        make_runner(fails=True).run(list(make_runner.steps.by_name.values()))
    assert state.is_done(make_runner.steps, make_runner.steps.by_name["a-1"])


def test_measuring_again_needs_the_runs(make_runner):
    steps = make_runner.steps
    step = steps.by_name["reach/a-1"]
    with pytest.raises(ConfigError, match="fresh: reach/a-1 needs the run"):
        make_runner().measure_again([step])
    make_runner().run([steps.by_name["a-1"], step])
    state.result_file("reach/a-1").write_text("{}")
    runner = make_runner()
    runner.measure_again([step])
    assert state.is_done(steps, step) and [tool for tool, _, _ in runner.calls] == ["eval"]


def test_a_stop_is_passed_on_and_waited_for(tmp_path, monkeypatch):
    """SIGTERM to the command reaches the process that it runs, which ends in its own way."""
    script = tmp_path / "child.py"
    script.write_text(
        "import signal, sys, time\n"
        "def stop(*_):\n    open(sys.argv[1], 'w').write('saved'); sys.exit(0)\n"
        "signal.signal(signal.SIGTERM, stop)\nprint('ready', flush=True)\ntime.sleep(60)\n"
    )
    code = (
        "import signal, sys\nfrom spin_rl.reproduce import run\n"
        "def stop(*_):\n    raise KeyboardInterrupt\n"
        "signal.signal(signal.SIGTERM, stop)\n"
        f"child = run._started([sys.executable, {str(script)!r}, {str(tmp_path / 'saved')!r}])\n"
        "run._wait([child], ['child'])\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert parent.stdout.readline() == b"ready\n"
    parent.send_signal(signal.SIGTERM)
    start = time.monotonic()
    assert parent.wait(timeout=30) != 0 and time.monotonic() - start < 20
    assert (tmp_path / "saved").read_text() == "saved"
    parent.communicate()


def test_curves_are_short_and_leave_out_what_is_unknown():
    count = 5 * POINTS
    values = [float("nan")] * 5 + [1.0] * (count - 5)
    curve = shorten([float(i) for i in range(count)], {"success_rate": values})
    assert len(curve["env_steps"]) == POINTS - 1 and set(curve["success_rate"]) == {1.0}
    assert curve["env_steps"][-1] == count - 1
    assert shorten([1.0], {"success_rate": [0.5]}) == {"env_steps": [1.0], "success_rate": [0.5]}


def test_list_is_what_happens_without_run(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["spin-reproduce", "only=fixcam_II"])
    reproduce.main()
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[2:6]] == [
        "fixcam_II-1", "fixcam_III-1", "reach/fixcam_II-1", "reach/fixcam_III-1"
    ]  # fmt: skip
    assert "of 4 steps done" in lines[6] and lines[7] == "run=true runs what is missing"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["only=nothing"], "only: no step has 'nothing'"),
        (["only=5"], "only"),
        (["processes=0"], "processes: expected"),
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
