"""A run as a file that can be read and replayed: a line of JSON for the start, every step and the end.

Lines are written as they happen, so that what a crash leaves can be read. Depth images are those that the
filter gets, compressed; what is measured is written with all its digits.
"""

from __future__ import annotations

import base64
import contextlib
import dataclasses
import json
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from spin_rl import robot
from spin_rl.config import ConfigError, Range, check_value, short
from spin_rl.deploy.agent import Inputs
from spin_rl.deploy.interface import Command, RobotState

_FORMAT = 1
_LENGTHS = {"joints": 8, "joint_velocity": 8, "joint_speed": 8, "base": 3, "base_velocity": 2}
_KINDS: dict[str, Any] = {"homed": bool, "runstop": bool}
_KINDS |= dict.fromkeys(("stamp_s", "forward", "turn"), Annotated[float, Range()])
"""What fields of states and commands are."""
_TAKEN: Any = _KINDS["stamp_s"] | None


class RunLog:
    """Writes a run's file."""

    def __init__(self, path: Path, facts: Mapping[str, Any]) -> None:
        """Begin the file; `facts` are what a replay must know, as JSON can hold it.

        Raises:
            ConfigError: It cannot be written.
        """
        try:
            if path.exists() and not (path.is_file() or path.is_dir()):  # a pipe would wait for a reader
                raise ConfigError(f"log: {path} cannot be written: it is not a regular file")
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = open(path, "w", encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"log: {path} cannot be written: {error.strerror}") from None
        self._write({"format": _FORMAT, **facts})

    def start(self, state: RobotState, goal: np.ndarray | None, object_b: np.ndarray | None) -> None:
        """Write what the episode starts from, see `Agent.reset`."""
        self._write({"start": pack(state), "goal": pack(goal), "object": pack(object_b)})

    def step(self, tick: int, late_s: float, inputs: Inputs, action: np.ndarray, command: Command) -> None:
        """Write a step: its number, how late it began [s], and what went in and came out."""
        depth = None if inputs.depth is None else pack_image(inputs.depth)
        told = {name: pack(values) for name, values in inputs.told.items()}
        line = {"tick": tick, "late_s": round(late_s, 6), "state": pack(inputs.state), "depth": depth}
        line |= {"taken_s": inputs.taken_s, "told": told}
        self._write({**line, "action": pack(action), "command": pack(command)})

    def end(self, values: Mapping[str, Any]) -> None:
        """Write how it ended."""
        self._write({"end": dict(values)})

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _write(self, line: Mapping[str, Any]) -> None:
        self._file.write(json.dumps(line) + "\n")
        self._file.flush()


@dataclass(frozen=True)
class LoggedStep:
    """A step as it was written."""

    tick: int
    inputs: Inputs
    action: np.ndarray
    command: Command


@dataclass(frozen=True)
class LoggedRun:
    """A run as it was written.

    Attributes:
        facts: As of `RunLog`.
        state: What the episode started from.
        goal: Where to drive in the frame of the odometry [m]; None without one.
        object_b: Where the object was at the start, in the base frame of then [m]; None without one.
        end: How it ended; None if nobody wrote that.
        path: Its file.
    """

    facts: Mapping[str, Any]
    state: RobotState
    goal: np.ndarray | None
    object_b: np.ndarray | None
    end: Mapping[str, Any] | None
    path: Path

    def steps(self) -> Iterator[LoggedStep]:
        """Read the steps one after the other."""
        for line in _lines(self.path):
            if "tick" in line:
                yield _step(line)


def read_log(path: Path) -> LoggedRun:
    """Read a run's file.

    Raises:
        ConfigError: There is none, or it is no log of a run that began.
    """
    if not path.is_file():
        raise ConfigError(f"replay: there is no file {path}")
    # Hours of steps need not fit into memory.
    lines = [line for line in _lines(path) if "tick" not in line]
    if not lines or lines[0].get("format") != _FORMAT:
        raise ConfigError(f"replay: {path} is no log of spin-deploy")
    begun = [line for line in lines if "start" in line]
    if not begun:
        raise ConfigError(f"replay: {path} ends before anything moved")
    end = [line["end"] for line in lines if "end" in line]
    with whole(path):
        return LoggedRun(
            facts=lines[0],
            state=_state(begun[0]["start"]),
            goal=_point(begun[0]["goal"], 2),
            object_b=_point(begun[0]["object"], 3),
            end=check_value(dict[str, Any], end[-1], "replay.end") if end else None,
            path=path,
        )


@contextlib.contextmanager
def whole(path: Path) -> Iterator[None]:
    """Turn what goes wrong while a log is read or replayed into one line.

    Raises:
        ConfigError: Something is missing there, or is not what it should be.
    """
    try:
        yield
    except ConfigError:
        raise
    except (LookupError, TypeError, ValueError, AttributeError, zlib.error) as error:
        raise ConfigError(f"replay: {path} is damaged: {type(error).__name__}, {error}") from None


def pack(value: Any) -> Any:
    """Turn arrays, and dataclasses that hold them, into lists and mappings."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: pack(getattr(value, field.name)) for field in dataclasses.fields(value)}
    return value


def pack_image(image: np.ndarray) -> dict[str, Any]:
    """Turn an image, float32, into what JSON can hold."""
    data = zlib.compress(np.ascontiguousarray(image, dtype="<f4").tobytes(), level=1)
    return {"shape": list(image.shape), "zlib_f4": base64.b64encode(data).decode()}


def unpack_image(packed: Mapping[str, Any]) -> np.ndarray:
    """Return the image of `pack_image`."""
    data = zlib.decompress(base64.b64decode(packed["zlib_f4"]))
    return np.frombuffer(data, dtype="<f4").reshape(packed["shape"])


def _step(line: Mapping[str, Any]) -> LoggedStep:
    depth = None if line["depth"] is None else unpack_image(line["depth"])
    told = {name: np.array(values, dtype=np.float32) for name, values in line["told"].items()}
    taken_s = check_value(_TAKEN, line.get("taken_s"), "replay.taken_s")
    inputs = Inputs(_state(line["state"]), depth, told, taken_s)
    command = Command(**_fields(line["command"]))
    return LoggedStep(line["tick"], inputs, _numbers(line["action"], len(robot.ACTIONS)), command)


def _state(packed: Mapping[str, Any]) -> RobotState:
    return RobotState(**_fields(packed))


def _fields(packed: Mapping[str, Any]) -> dict[str, Any]:
    """Read numbers, truths, and arrays of a known length."""
    return {
        key: _numbers(value, _LENGTHS[key])
        if key in _LENGTHS
        else check_value(_KINDS[key], value, f"replay.{key}")
        for key, value in packed.items()
    }


def _point(value: Any, length: int) -> np.ndarray | None:
    return None if value is None else _numbers(value, length)


def _numbers(value: Any, length: int) -> np.ndarray:
    numbers = np.array(value, dtype=float)
    if numbers.shape != (length,):
        raise ValueError(f"expected {length} numbers, got {short(value)}")
    return numbers


def _lines(path: Path) -> Iterator[dict[str, Any]]:
    """Read the whole lines of a file; the last one may have been cut off."""
    with open(path, encoding="utf-8", errors="replace") as file:
        for line in file:
            try:
                value = json.loads(line)
            except json.JSONDecodeError:
                return
            if not isinstance(value, dict):
                return
            yield value
