"""A runner of the plan whose processes are small scripts."""

import json
import sys
import textwrap

import pytest

from spin_rl.reproduce import run, state
from spin_rl.reproduce.plan import read_steps

PLAN = {
    "budgets": {"drive": {"env_steps": 100_000, "minutes": 10, "arguments": ["preset=cpu"]}},
    "groups": [
        {
            "name": "one",
            "claim": "c",
            "trainings": [
                {"name": "a", "seeds": [1, 2]},
                {"name": "b", "seeds": [1], "arguments": ["teacher={a}"], "evaluate": False},
            ],
        }
    ],
}
# Trains or measures and leaves behind what those do, and a line in `events` at its begin and end. As the file
# `how` says of a step, it is slow, fails, holds on until it is asked to end, or does not even end then.
FAKE = textwrap.dedent("""
    import json, os, pathlib, signal, sys, time
    box = pathlib.Path(sys.argv[1])
    tool, *arguments = sys.argv[2:]
    given = dict(argument.split("=", 1) for argument in arguments)
    folder = pathlib.Path(given.get("resume") or given.get("run_dir") or given["policy"])
    name = folder.name if tool == "train" else pathlib.Path(given["out"]).stem.replace("-", "/", 1)
    how = json.loads((box / "how").read_text()).get(name)
    asked = []
    signal.signal(signal.SIGTERM, lambda *_: asked.append(1))

    def note(what):
        with open(box / "events", "a") as events:
            events.write(f"{what} {name}\\n")

    assert os.getsid(0) == os.getpid()  # a Ctrl-C of the terminal does not reach it
    note("begin")
    print("0.040 M env steps | success 12.0%", flush=True)
    if how == "fails":
        print("spin-train: error: it is broken")
        sys.exit(3)
    time.sleep(0.5 * (how == "slow"))
    while how == "hangs" or how == "holds" and not asked:
        time.sleep(0.01)
    if tool == "train":
        before = folder / "summary.json"
        samples = json.loads(before.read_text())["env_steps"] if before.exists() else 0
        samples += 40_000 if asked else 100_000
        (folder / "checkpoints").mkdir(parents=True, exist_ok=True)
        (folder / "checkpoints" / "last.pt").touch()
        whole = folder / "whole.json"
        whole.write_text(json.dumps(dict(env_steps=samples, minutes=1.0, success_rate=0.5, processes=1)))
        whole.replace(before)
    else:  # an evaluation that is asked to end writes what it has by then
        row = dict(success_rate=0.5, episodes=2, outcomes="sc", duration_s=None, timeout_rate=0.5)
        row |= dict(final_distance_m=1.0, final_distance_ci95=[0.5, 1.5])
        cells = [dict(scenario=s, difficulty=d) for s in (1, 2) for d in ("easy", "medium", "hard")]
        result = dict(rows=[row | cell for cell in cells], seeds=[0], num_envs=6, commit=None, device="cpu")
        result |= dict(policy=given["policy"])
        result |= dict(stopped=True) if asked else {}
        pathlib.Path(given["out"]).write_text(json.dumps(result))
    note("end")
""")


@pytest.fixture
def make_runner(tmp_path, monkeypatch):
    """Makes runners of `PLAN`; `how` says what is special about steps."""
    monkeypatch.setattr(state, "RESULT_DIR", tmp_path / "results")
    monkeypatch.setattr("spin_rl.reproduce.record.read_curve", lambda folder: {})
    monkeypatch.setattr(run, "_POLL_S", 0.01)
    script = tmp_path / "fake.py"
    script.write_text(FAKE)

    def make(how=None, jobs=2, **options):
        (tmp_path / "how").write_text(json.dumps(how or {}))
        (tmp_path / "events").write_text("")
        lines, calls = [], []
        runner = run.Runner(make.steps, jobs, report=lines.append, **options)
        runner.lines, runner.calls = lines, calls

        def python(tool, arguments):
            calls.append((tool, list(arguments)))
            return [sys.executable, str(script), str(tmp_path), tool, *arguments]

        monkeypatch.setattr(run, "python", python)
        return runner

    make.plan = PLAN
    make.steps = read_steps(PLAN, tmp_path / "runs")
    make.all = list(make.steps.by_name.values())
    make.events = lambda: [tuple(line.split()) for line in (tmp_path / "events").read_text().splitlines()]
    return make
