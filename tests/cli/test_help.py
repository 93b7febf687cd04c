"""What commands say before anything slow is imported: help, refusals, and what there is."""

import json
import subprocess
import sys

import pytest

from spin_rl.cli import catalogue, commands, help_text, refusals, resume
from spin_rl.cli.commands import MODULES
from spin_rl.config import ConfigError
from spin_rl.paths import CONF_DIR
from spin_rl.tasks.common.compose import compose

SLOW = ("torch", "tensordict", "mujoco_warp", "rsl_rl", "scipy", "matplotlib")
RUN = """
import json, sys, time
sys.argv = json.loads(sys.argv[1])
from spin_rl.cli import commands
try:
    getattr(commands, sys.argv.pop(0))()
except SystemExit:
    pass
print("CPU", time.process_time(), *[name for name in {slow} if name in sys.modules])
""".replace("{slow}", repr(SLOW))


def call(function, *arguments):
    """Run a command in a process of its own; return its output, CPU time [s] and the slow modules."""
    line = json.dumps([function, f"spin-{function}", *arguments])
    done = subprocess.run([sys.executable, "-c", RUN, line], capture_output=True, text=True, check=True)
    text, _, facts = (done.stderr + done.stdout).rpartition("CPU ")
    seconds, *slow = facts.split()
    return text, float(seconds), slow


@pytest.mark.parametrize("name", MODULES)
def test_help_fits_on_a_screen(name):
    lines = help_text.of(name).splitlines()
    assert lines[0].startswith(f"spin-{name}: ") and any(line.startswith(f"  spin-{name} ") for line in lines)
    assert len(lines) <= 42 and max(map(len, lines)) <= 120
    assert "${" not in "".join(line[:30] for line in lines if not line.startswith("  init"))


def test_help_tells_the_keys_and_their_meanings():
    text = help_text.of("train")
    rows = {line.split()[0].partition("=")[0]: line for line in text.splitlines() if line.startswith("  ")}
    for key in ("preset", "task", "reward", "max_minutes", "resume", "seed", "evaluate"):
        assert len(rows[key].split()) > 2, key
    assert "--cfg=job" in text and "docs/training.md" in text


def test_help_needs_no_imports():
    text, seconds, slow = call("train", "--help")
    assert text.startswith("spin-train: ") and slow == [] and seconds < 1.0


def test_a_list_of_steps_needs_no_torch():
    text, _, slow = call("reproduce")
    assert "reach/cvo-1" in text and slow == []


@pytest.mark.parametrize(
    ("command", "arguments", "expected"),
    [
        ("evaluate", ["policy=nav-cvo", "task.difficulty=3"], "task.difficulty must be -1, 0, 1 or 2, got 3"),
        ("evaluate", ["policy=nav-cvo", "task.difficulty=hrad"], "choose from any, easy, medium, hard"),
        ("evaluate", ["policy=no-such"], "policy: There is no policy 'no-such'"),
        ("evaluate", ["policy=nav-cvo", "episode=3"], "episode: unknown key; did you mean episodes?"),
        ("evaluate", ["policy=nav-cvo", "+episode=3"], "episode: unknown key; did you mean episodes?"),
        ("train", ["device=cpu", "scene.width=0.1"], "scene.width must leave"),
        ("train", ["reward=shape"], "reward: unknown 'shape'; choose from careful"),
        ("train", ["resume=no-such"], "resume: There is no checkpoint at no-such."),
        ("play", ["policy=no-such", "device=cpu"], "policy: There is no policy 'no-such'"),
        ("distill", ["teacher=no-such", "device=cpu"], "teacher: There is no policy 'no-such'"),
        ("export", ["policy=no-such"], "policy: There is no policy 'no-such'"),
        (
            "export",
            ["policy=nav-cvo", "fetch=true", "out=/etc/passwd"],
            "out: /etc/passwd is a file; a fetch",
        ),
    ],
)
def test_a_refusal_needs_no_torch(command, arguments, expected):
    text, seconds, slow = call(command, *arguments)
    assert expected in text and len(text.strip().splitlines()) == 1
    assert slow == [] and seconds < 4.0  # about one on an idle core


def test_every_command_has_a_function_and_a_file():
    assert {name for name in MODULES if (CONF_DIR / f"{name}.yaml").is_file()} == set(MODULES)
    functions = {"eval": commands.evaluate, "list": commands.list_}
    assert all(callable(functions.get(name) or getattr(commands, name)) for name in MODULES)


@pytest.mark.parametrize(
    ("key", "expected"),
    [
        ("task.dificulty", "did you mean task.difficulty?"),
        ("max_minute", "did you mean max_minutes?"),
        ("task.curriculum.begin", "choose from task.curriculum.down, task.curriculum.enabled"),
        ("xyzzy", "see spin-train --help"),
    ],
)
def test_unknown_keys_are_told_what_was_meant(key, expected):
    assert expected in refusals.unknown_key(key, "train")


def test_the_catalogue_names_what_there_is(tmp_path, monkeypatch, capsys):
    assert [name for name, _ in catalogue.tasks()] == ["fetch", "nav", "pick"]
    named = dict(catalogue.policies())
    assert named["nav-cvo"].startswith("task=nav: ") and named["pick-depth"].startswith("task=pick: ")
    assert {"nav", "mixture", "lab.yaml"} <= {name for name, _ in catalogue.scenes()}
    folder = tmp_path / "checkpoints"
    folder.mkdir()
    with pytest.raises(ConfigError, match="holds no checkpoint"):
        catalogue.checkpoints(tmp_path)
    for name in ("iteration_0000002.pt", "last.pt", "iteration_0000010.pt"):
        (folder / name).write_bytes(b"")
    names = [path.rpartition("/")[2] for path, _ in catalogue.checkpoints(tmp_path)]
    assert names == ["last.pt", "iteration_0000010.pt", "iteration_0000002.pt"]
    monkeypatch.setattr(sys, "argv", ["spin-list", "nonsense"])
    with pytest.raises(SystemExit) as stopped:
        catalogue.main()
    assert stopped.value.code == 2
    assert capsys.readouterr().err.startswith("spin-list: error: nonsense: is neither")


KEPT = ["num_envs=64", "preset=cpu", "reward.collision=-5", "reward=careful", "+reward.goal_speed=0.1"]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (["resume=run"], [*KEPT, "resume=run"]),
        (["resume=run", "num_envs=16"], [*KEPT[1:], "resume=run", "num_envs=16"]),
        (["resume=run", "reward=paper"], [*KEPT[:2], "resume=run", "reward=paper"]),
        (["resume=run", "reward.collision=-1"], [*KEPT[:2], *KEPT[3:], "resume=run", "reward.collision=-1"]),
        (["resume=null"], None),
        (["num_envs=16"], None),
    ],
)
def test_a_resumed_run_keeps_its_settings(monkeypatch, given, expected):
    monkeypatch.setattr(resume, "_settings_of", lambda path: KEPT)
    assert resume.with_settings_of_run(given) == expected
    if expected is not None:
        assert compose("train", expected)["num_envs"] == (16 if "num_envs=16" in given else 64)


def test_what_is_kept_of_a_call():
    given = ["num_envs=64", "resume=a", "run_dir=b", "max_minutes=3", "-m", "~reward.time", "seed=3"]
    assert resume.to_keep(given) == ["num_envs=64", "~reward.time", "seed=3"]


@pytest.mark.parametrize(
    "override", ["+reward.my_package.term=0.1", "runner.actor.class_name=my_package:Actor"]
)
def test_code_from_outside_is_not_run_for_a_checkpoints_sake(monkeypatch, override):
    monkeypatch.setattr(resume, "_settings_of", lambda path: [override, "num_envs=8"])
    with pytest.raises(ConfigError, match=r"resume: the run has .* code from outside"):
        resume.with_settings_of_run(["resume=run"])
    again = override.lstrip("+")
    assert resume.with_settings_of_run(["resume=run", again]) == ["num_envs=8", "resume=run", again]
