"""The table of learning from scandots against learning from depth images."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from spin_rl.benchmark.tables.paper import DIRECT_DEPTH_SUCCESS, FRAMES_PER_S
from spin_rl.config import ConfigError
from spin_rl.reproduce.tables.notes import COMMANDS, budget_note, episodes_note, known
from spin_rl.reproduce.tables.stored import Measured, Stored
from spin_rl.reproduce.tables.table import Table, compare

_METHODS = {"scandots": "cvo", "depth": "direct_depth"}
"""What is learned from -> name of its trainings."""
_WITH_IMAGES = "env step with depth images"
"""Row of spin-bench: steps with images, and as its baseline those without."""


def depth(stored: Stored) -> Table:
    """Steps a second and what was learned in about equal time; also at equal samples.

    Raises:
        NothingStored: Something is missing: its rows are of all three measurements.
    """
    methods = stored.reach(_METHODS)
    speed = stored.find("speed/images")
    stored.refuse_missing()
    assert speed is not None
    row = next((row for row in speed["result"]["rows"] if row["name"] == _WITH_IMAGES), None)
    if row is None:
        raise ConfigError(f"table: speed/images has no row '{_WITH_IMAGES}'")
    frames = {"scandots": row["baseline_value"], "depth": row["value"]}
    paper_success = {"scandots": "", "depth": f"< {DIRECT_DEPTH_SUCCESS:.2f}"}
    samples = min(_samples(method) for method in methods.values())
    rows: list[tuple[str, ...]] = []
    records: list[Mapping[str, Any]] = []
    for label, method in methods.items():
        rate = method.rate()
        minutes = _minutes(method)
        curves = [training["curve"] for training in method.trainings]
        equal, level = (
            _mean(at_samples(curve, key, samples) for curve in curves) for key in ("success_rate", "level")
        )
        learning = _samples(method) / (60.0 * minutes)
        rows.append(
            (
                label,
                f"{frames[label]:,.0f}",
                f"{FRAMES_PER_S[label]:,.0f}",
                f"{learning:,.0f}",
                f"{_samples(method) / 1e6:.1f} M",
                f"{minutes:.0f} min",
                rate.text(),
                paper_success[label] or "not given",
                f"{equal:.2f} at level {level:.2f}",
                method.steps,
            )
        )
        low, high = rate.interval
        records.append(
            {
                "learned_from": label,
                "frames_per_s": frames[label],
                "paper_frames_per_s": FRAMES_PER_S[label],
                "training_steps_per_s": learning,
                "env_steps": _samples(method),
                "minutes": minutes,
                "success_rate": rate.value,
                "ci95_low": low,
                "ci95_high": high,
                "episodes": rate.episodes,
                "training_success_at_equal_samples": equal,
                "training_level_at_equal_samples": level,
                "trainings": method.steps,
            }
        )
    every = list(methods.values())
    ratio, paper_ratio = (values["scandots"] / values["depth"] for values in (frames, FRAMES_PER_S))
    return Table(
        "depth",
        (
            "learned from",
            "simulated/s",
            "simulated/s, paper's",
            "trained/s",
            "samples",
            "time",
            "success",
            "success, paper's",
            f"in training at {samples / 1e6:.1f} M",
            "trainings",
        ),
        tuple(rows),
        tuple(records),
        claims=(
            compare(
                f"scandots over depth images, {_budget(methods['scandots'])} and {_budget(methods['depth'])}",
                methods["scandots"].rate(),
                methods["depth"].rate(),
                paper=None,
                wanted=0.10,
            ),
        ),
        notes=(
            budget_note(every),
            episodes_note(every),
            f"the paper has less than {DIRECT_DEPTH_SUCCESS:.2f} for depth images after 22 h, and no figure "
            "for scandots alone: both of its phases took 16 h, of which the rows here are the first",
            "in training: success in corridors that become harder with it, from level 0 to 1",
            f"simulated {ratio:.1f} times as fast with scandots alone ({speed['hardware']}), paper "
            f"{paper_ratio:.0f} times (one GPU, 8192 worlds and 256): `{speed['command']}`, commit "
            f"{known([speed['commit']])}",
            COMMANDS,
        ),
    )


def at_samples(curve: Mapping[str, list[float]], key: str, samples: float) -> float:
    """A figure in training at a number of samples, that of the nearest point of the curve."""
    points = list(zip(curve["env_steps"], curve[key], strict=True))
    return min(points, key=lambda point: abs(point[0] - samples))[1]


def _budget(method: Measured) -> str:
    return f"{_samples(method) / 1e6:.1f} M steps in {_minutes(method):.0f} min"


def _minutes(method: Measured) -> float:
    return _mean(training["minutes"] for training in method.trainings)


def _samples(method: Measured) -> float:
    return _mean(training["env_steps"] for training in method.trainings)


def _mean(values: Any) -> float:
    values = list(values)
    return sum(values) / len(values)
