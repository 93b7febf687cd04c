"""spin-deploy: let an exported policy drive a robot, or one in C MuJoCo; or replay the log of a run.

Without Hydra, Torch and Warp, which a robot's own computer need not have.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from spin_rl import __version__
from spin_rl.config import POSITIVE, ConfigError, Range, from_keys, from_mapping
from spin_rl.deploy.backends import BACKENDS, open_backend
from spin_rl.deploy.fetch.agent import files_of, open_agent
from spin_rl.deploy.log import RunLog, pack, read_log, whole
from spin_rl.deploy.loop import DONE, ControlLoop, Outcome
from spin_rl.deploy.replay import replay

_ROBOT = "robot."
USAGE = f"""spin-deploy policy=<file.onnx> backend=<{"|".join(BACKENDS)}|a module> [key=value ...]
spin-deploy replay=<log>

  policy       file that spin-export wrote, or the folder of a fetch
  backend      robot to drive; robot.<key>=<value> are its settings, for mujoco robot.scene=<file.yaml>
  goal         where to drive, in the frame of the odometry [m]; a scene has its own
  object       where the object to pick is, in the frame of the base [m]: [x,y,z]
  max_s        longest time [s], 60
  speed_scale  factor on all speeds, above 0 and at most 1, 1
  pilot        false leaves out the guard and the planner that the policy was trained with, true
  log          <file.jsonl> to write, to be replayed later
  replay       <file.jsonl> runs what it holds through the policy again, which must give the same actions

Ctrl-C stops the robot. Status: 0 arrived or placed, 1 time is over or replay differs, 2 refused, 3 stopped.
"""


@dataclass(frozen=True)
class Options:
    """What to run, checked; see `USAGE`."""

    policy: Path | None = None
    backend: str | None = None
    goal: tuple[float, float] | None = None
    object: tuple[float, float, float] | None = None
    max_s: Annotated[float, POSITIVE] = 60.0
    speed_scale: Annotated[float, Range(0.0, 1.0, above=True)] = 1.0
    pilot: bool = True
    log: Path | None = None
    replay: Path | None = None


@dataclass(frozen=True)
class _Facts:
    """What a replay must know of a run."""

    policy: Path
    name: str
    sha256: str
    speed_scale: Annotated[float, Range(0.0, 1.0, above=True)]
    pilot: bool = True


def main() -> None:
    """Entry point of the `spin-deploy` command."""
    arguments = sys.argv[1:]
    if not arguments or {"-h", "--help"} & set(arguments):
        print(USAGE)
        sys.exit(0 if arguments else 2)
    try:
        options, settings = read_arguments(arguments)
        status = _replay(options) if options.replay is not None else _deploy(options, settings)
    except KeyboardInterrupt:
        status = 3
    except (ValueError, OSError) as error:
        if os.environ.get("HYDRA_FULL_ERROR") == "1":
            raise
        print(f"spin-deploy: error: {error}", file=sys.stderr)
        status = 2
    sys.exit(status)


def read_arguments(arguments: Sequence[str]) -> tuple[Options, dict[str, Any]]:
    """Read `key=value` arguments: the command's own options, and the settings of the back end.

    Raises:
        ConfigError: One line that names the key.
    """
    values: dict[str, Any] = {}
    for argument in arguments:
        key, sign, value = argument.partition("=")
        if not sign or not key:
            raise ConfigError(f"{argument}: expected key=value")
        values[key] = _value(value)
    settings = {key.removeprefix(_ROBOT): v for key, v in values.items() if key.startswith(_ROBOT)}
    own = {key: value for key, value in values.items() if not key.startswith(_ROBOT)}
    options = from_mapping(Options, own)
    if options.replay is None:
        for field in fields(Options)[:2]:
            if getattr(options, field.name) is None:
                raise ConfigError(f"{field.name}: a value is needed; spin-deploy --help")
    return options, settings


def _value(text: str) -> Any:
    """Read a number, list, true, false or null as JSON; all else is text."""
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text


def _deploy(options: Options, settings: dict[str, Any]) -> int:
    assert options.policy is not None and options.backend is not None
    agent = open_agent(options.policy, options.speed_scale, pilot=options.pilot)
    if options.log is not None and options.log.resolve() in map(Path.resolve, files_of(options.policy)):
        raise ConfigError(f"log: {options.log} is the policy's own file")
    robot = open_backend(options.backend, settings, agent.contract)
    log = None
    try:
        connection = robot.connect()
        if options.log is not None:
            log = RunLog(options.log, _facts(options, settings, agent.contract.name))
        loop = ControlLoop(robot, connection, agent, log)
        goal, thing = options.goal or connection.goal, options.object or connection.object_b
        print(f"{agent.contract.name} drives {options.backend}; Ctrl-C stops it", flush=True)
        outcome = loop.run(options.max_s, _point(goal), _point(thing))
    finally:
        robot.close()
        if log is not None:
            log.close()
    print(_summary(outcome))
    if options.log is not None:
        print(f"Wrote {options.log}")
    return 3 if outcome.stopped else 0 if outcome.reason in DONE else 1


def _replay(options: Options) -> int:
    assert options.replay is not None
    run = read_log(options.replay)
    with whole(options.replay):
        facts = from_keys(_Facts, run.facts, "replay")
    path = options.policy or facts.policy
    agent = open_agent(path, facts.speed_scale, pilot=facts.pilot)
    if agent.contract.name != facts.name:
        raise ConfigError(f"policy: {path} is {agent.contract.name}, and {options.replay} is of {facts.name}")
    if _digest(path) != facts.sha256:
        print(f"warning: {path} is not the file that ran then", file=sys.stderr)
    result = replay(run, agent)
    ended = run.end["reason"] if run.end is not None else "nobody wrote how it ended"
    print(f"{options.replay}: {result.steps} steps ({ended})")
    print(f"largest difference: actions {result.action_error:.2e}, commands {result.command_error:.2e}")
    print("the same" if result.agrees else f"differs from step {result.first} on")
    return 0 if result.agrees else 1


def _facts(options: Options, settings: dict[str, Any], name: str) -> dict[str, Any]:
    """What a log tells of the run beside its steps."""
    assert options.policy is not None
    return {
        "program": __version__,
        "policy": str(options.policy.resolve()),
        "name": name,
        "sha256": _digest(options.policy),
        "speed_scale": options.speed_scale,
        "pilot": options.pilot,
        "options": {key: str(value) for key, value in asdict(options).items() if value is not None},
        "robot": pack(settings),
    }


def _summary(outcome: Outcome) -> str:
    distance = "" if outcome.distance_m is None else f", {outcome.distance_m:.2f} m from the goal"
    ticks = f"{outcome.steps} commands, {outcome.missed} missed"
    return f"{outcome.reason}: {outcome.duration_s:.1f} s, {ticks}{distance}"


def _point(values: Sequence[float] | None) -> np.ndarray | None:
    return None if values is None else np.array(values, dtype=float)


def _digest(path: Path) -> str:
    return hashlib.sha256(b"".join(file.read_bytes() for file in files_of(path))).hexdigest()


if __name__ == "__main__":
    main()
