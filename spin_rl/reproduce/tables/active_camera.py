"""The table of an actuated camera against constant poses that were trained in, by kinds of places."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from spin_rl.reproduce.state import read_result
from spin_rl.reproduce.tables.camera_variants import motion_lines, variant_records, variant_rows
from spin_rl.reproduce.tables.notes import INTERVALS, budget_note
from spin_rl.reproduce.tables.rates import Rate, difference, spread
from spin_rl.reproduce.tables.stored import Measured, Stored, refuse_other_scenes
from spin_rl.reproduce.tables.table import Claim, Table

KIND, FREEZE, SIGHT = "active_camera", "active_camera_freeze", "active_camera_sight"
"""Kinds of results: of trainings, of their camera analysis, of the screening."""
FETCH = "active_camera_fetch"
"""Kind of results of whole fetches, by policies whose camera is free and by others that have one pose."""
LEARN, LEARN_IN = "learn", "beam"
"""The group of trainings that learn in other ways, and the one whose free camera they are compared with."""
ALONE, IMITATES = "learn_alone", "algo=gaze"
"""Of that group, the one with which those without a gaze to imitate are compared, and what others have."""
FREE = "free"
"""In fetches: what the others are compared with."""
_FETCH_CAMERAS = {"frozen": "free, frozen at", "blind": "free, blind"}
"""What the free policies' camera is without having been trained so: the freeze test, and the control."""
MET = "met"
"""Verdict of a difference that is large enough on average, and has the same sign between all trainings."""
WANTED = 0.15
"""Difference to every constant pose from which the camera's motion counts as worth its motors."""
_HELD = ("task.camera_pose=", "task.camera_frozen_after_s=")
"""Arguments of those whose camera has a constant pose, given or chosen at the start."""
_HEADER = ("places", "camera", "success", "each", "collisions", "time-outs", "difference", "trainings")


@dataclass(frozen=True)
class Margin(Claim):
    """How much better the camera that moves is than another."""

    @property
    def verdict(self) -> str:
        """Whether that is enough."""
        if self.low <= 0.0 <= self.high:
            return "no difference shown"
        if self.high < 0.0:
            return self.qualified("the other way round")
        return self.qualified(MET if self.ours >= self.wanted else "better, by less than wanted")

    @property
    def reach(self) -> str:
        """What the verdict does not say: that some pair of trainings lies closer."""
        is_close = self.verdict == MET and self.trainings is not None and self.trainings[0] < self.wanted
        return " on average, not between all trainings" if is_close else ""

    def line(self) -> str:
        """All of it in a line."""
        return f"{self.text}: {self.measured()}, wanted {self.wanted:+.2f}: {self.verdict}{self.reach}"


def active_camera(stored: Stored) -> Table:
    """Success of the free camera beside constant poses, one chosen at the start, and none at all."""
    groups = _groups(stored)
    _refuse_unfinished(stored, groups)
    rows: list[tuple[str, ...]] = []
    records: list[Mapping[str, Any]] = []
    margins: list[Margin] = []
    notes: list[str] = []
    every: list[Measured] = []
    for group, names in groups.items():
        methods = {name: stored.of_trainings(KIND, name) for name in names}
        every += methods.values()
        free = stored.of_trainings(KIND, f"{LEARN_IN if group == LEARN else group}_free")
        own: dict[str, Margin] = {}
        for name, method in methods.items():
            reference = methods[ALONE] if group == LEARN and _learns_alone(name, method) else free
            if method.name != reference.name:
                own[name] = margin_over(name, reference, method)
            rows.append(_row(group, name, method, own.get(name)))
            records.append(_record(group, name, method, own.get(name)))
        if group != LEARN:
            margins += own.values()
            notes.append(_worth(group, [own[name] for name in own if _is_held(methods[name])]))
            notes.append(_bound(group, stored.result(f"{SIGHT}/{group}")))
        for name in _analysed(stored, names):
            analysed = stored.of_trainings(FREEZE, name)
            rows += variant_rows(group, _short(name), analysed)
            records += variant_records(group, _short(name), analysed)
            notes += motion_lines(analysed)
    if (fetches := _fetches(stored)) is not None:
        over = {name: _over_in_fetches(fetches, name) for name in fetches if name != FREE}
        rows += [_fetch_row(fetches, name, over.get(name)) for name in fetches]
        records += [_record("fetch", name, method, over.get(name)) for name, method in fetches.items()]
        margins += over.values()
        every += fetches.values()
        notes.append(_worth("fetch", [margin for name, margin in over.items() if name not in _FETCH_CAMERAS]))
        notes.append(_bound("fetch", stored.result(f"{SIGHT}/fetch")))
    return Table(
        "active_camera",
        _HEADER,
        tuple(rows),
        tuple(records),
        claims=tuple(margins),
        notes=(
            *notes,
            budget_note(every, "trained"),
            f"difference: free less this, in the same scenes; {ALONE} less this for other ways to learn that "
            "have no gaze to imitate; of a camera that is frozen or drawn, the policy's own less this; "
            f"intervals: 95 %, {INTERVALS}",
        ),
    )


def _groups(stored: Stored) -> dict[str, list[str]]:
    """Names of the trainings of each group that has results; of the first one where nothing has any.

    Kinds of places are trained one after the other: those that nobody began are left out.
    """
    names: dict[str, list[str]] = {}
    begun = set()
    for step in stored.steps.by_name.values():
        if step.name.startswith(f"{KIND}/"):
            names.setdefault(step.group, []).append(step.name.partition("/")[2].rpartition("-")[0])
            if read_result(step.name) is not None:
                begun.add(step.group)
    chosen = {group: list(dict.fromkeys(found)) for group, found in names.items()}
    if not begun and not _fetches_are_begun(stored):
        return dict([*chosen.items()][:1])
    return {group: found for group, found in chosen.items() if group in begun}


def _refuse_unfinished(stored: Stored, groups: Mapping[str, Sequence[str]]) -> None:
    """Refuse groups that are not whole, with all that they lack.

    Raises:
        NothingStored: They lack something.
    """
    for group, names in groups.items():
        for name in names:
            stored.measured(KIND, name)
        for name in _analysed(stored, names):
            stored.measured(FREEZE, name)
        if group != LEARN:
            stored.measured(FREEZE, f"{group}_free")
            stored.find(f"{SIGHT}/{group}")
    stored.refuse_missing()


def _analysed(stored: Stored, names: Sequence[str]) -> list[str]:
    """Of some trainings those of which the plan has a camera analysis."""
    return [name for name in names if f"{FREEZE}/{name}-1" in stored.steps.by_name]


def _fetches_are_begun(stored: Stored) -> bool:
    return any(read_result(name) is not None for name in _names_of_fetches(stored))


def _names_of_fetches(stored: Stored) -> list[str]:
    return [name for name in stored.steps.by_name if name.startswith(f"{FETCH}/")]


def _fetches(stored: Stored) -> dict[str, Measured] | None:
    """Results of whole fetches by what is done with the camera, None where nobody began them.

    Raises:
        NothingStored: They lack something.
    """
    if not _fetches_are_begun(stored):
        return None
    names = _names_of_fetches(stored)
    cameras = dict.fromkeys(name.partition("/")[2].rpartition("-")[0] for name in names)
    found = {camera: stored.measured(FETCH, camera) for camera in cameras}
    stored.find(f"{SIGHT}/fetch")
    stored.refuse_missing()
    return found


def _over_in_fetches(fetches: Mapping[str, Measured], name: str) -> Margin:
    return margin_over(f"{name} in fetches", fetches[FREE], fetches[name])


def _fetch_row(fetches: Mapping[str, Measured], name: str, margin: Margin | None) -> tuple[str, ...]:
    method = fetches[name]
    overall = [result["result"]["overall"] for result in method.results]

    def mean(key: str) -> str:
        return f"{sum(values[key] for values in overall) / len(overall):.2f}"

    pose = method.results[0]["result"]["camera_pose"]
    return (
        "fetch",
        _FETCH_CAMERAS.get(name, name) + ("" if pose is None else f" [{pose[0]:g},{pose[1]:g}]"),
        method.rate().text(),
        method.rate().each_text(),
        mean("collision_rate"),
        mean("timeout_rate"),
        "-" if margin is None else f"{margin.ours:+.2f} ({margin.low:+.2f} to {margin.high:+.2f})",
        method.steps,
    )


def _learns_alone(name: str, method: Measured) -> bool:
    return name != ALONE and IMITATES not in method.trainings[0]["arguments"]


def _is_held(method: Measured) -> bool:
    arguments = method.trainings[0]["arguments"]
    return any(argument.startswith(_HELD) for argument in arguments)


def margin_over(name: str, free: Measured, other: Measured) -> Margin:
    """Compare trainings in the same scenes.

    Args:
        name: Of the others.
        free: Those whose camera moves; where there are fewer of the others, as many of them.
        other: The others.

    Raises:
        ConfigError: Their scenes were not the same.
    """
    refuse_other_scenes(f"{name} and {free.name}", (*free.results, *other.results))
    own, others = Rate(free.rate().wins[: len(other.results)]), other.rate()
    between = spread(own.each, others.each)
    return Margin(f"{free.name} over {name}", *difference(own, others), between, None, WANTED)


def _row(group: str, name: str, method: Measured, margin: Margin | None) -> tuple[str, ...]:
    each = method.rate().each_text()
    return (
        group,
        _camera(name, method),
        method.rate().text(),
        each,
        f"{method.mean('collision_rate') or 0.0:.2f}",
        f"{method.mean('timeout_rate') or 0.0:.2f}",
        "-" if margin is None else f"{margin.ours:+.2f} ({margin.low:+.2f} to {margin.high:+.2f})",
        method.steps,
    )


def _record(group: str, name: str, method: Measured, margin: Margin | None) -> dict[str, Any]:
    low, high = method.rate().interval
    return {
        "places": group,
        "camera": name,
        "success_rate": method.rate().value,
        "ci95_low": low,
        "ci95_high": high,
        "episodes": method.rate().episodes,
        "each_training": " ".join(f"{rate:.4f}" for rate in method.rate().each),
        "difference": None if margin is None else margin.ours,
        "difference_low": None if margin is None else margin.low,
        "difference_high": None if margin is None else margin.high,
        "trainings": method.steps,
    }


def _worth(group: str, held: Sequence[Margin]) -> str:
    """Whether the free camera is worth its motors in a kind of places: by its strongest opponent."""
    least = min(held, key=lambda margin: margin.ours)
    is_worth = all(margin.verdict == MET for margin in held)
    reach = max((margin.reach for margin in held), key=len) if is_worth else ""
    return (
        f"{group}: the free camera is {'' if is_worth else 'not '}worth its motors by the criterion{reach}; "
        f"the smallest difference to a constant pose, given or chosen: {least.text}, {least.measured()}"
    )


def _camera(name: str, method: Measured) -> str:
    """A training's own name, and where its camera is held or when it chooses that."""
    label = _short(name)
    given = dict(argument.split("=", 1) for argument in method.trainings[0]["arguments"])
    if pose := given.get("task.camera_pose"):
        return f"{label} {pose}"
    time_s = given.get("task.camera_frozen_after_s")
    return label if time_s is None else f"{label}, frozen after {time_s} s"


def _short(name: str) -> str:
    """A training's name without its places."""
    return name.partition("_")[2].replace("_", " ")


def _bound(group: str, sight: Mapping[str, Any]) -> str:
    """What the screening says can be won at most."""
    cameras = {camera["name"]: camera for camera in sight["result"]["groups"][0]["cameras"]}
    held, swings, around = (cameras[name] for name in ("held", "to and fro", "looks around"))
    pan, tilt = held["poses"][0]
    return (
        f"{group}, by the screening: in {held['unseen']:.2f} of the episodes the best constant pose "
        f"({pan:.2f}, {tilt:.2f}) misses something decisive, one that goes to and fro between two in "
        f"{swings['unseen']:.2f}, one that knows where to look in {around['unseen']:.2f}"
    )
