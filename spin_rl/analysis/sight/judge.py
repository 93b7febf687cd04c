"""What a record says of cameras: which obstacles were decisive, when, and who would have seen them by then.

Everything is computed from `Record`s on the host; arrays over events have a row for every decisive obstacle
of every episode.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spin_rl.analysis.sight.options import SightOptions
from spin_rl.analysis.sight.record import Record

DWELL_S = 0.3
"""How long the camera that goes to and fro stays at either pose."""

_PATIENCE = 0.9
"""What showing an obstacle one control step later is worth less, to the camera that looks around."""


@dataclass(frozen=True)
class Events:
    """Decisive obstacles.

    Attributes:
        world: Whose episode it was, shape (n,).
        step: When it counted: the observation at which it lay on the course for the first time, or, where it
            was too late then, the last one before at which braking would have avoided it, shape (n,).
        shows: Whether a head pose at an observation would have shown it in a way that is still known when it
            counted, shape (n, steps, npose), bool; nothing later than `step` is.
        worlds: Number of episodes.
    """

    world: np.ndarray
    step: np.ndarray
    shows: np.ndarray
    worlds: int

    def failed(self, seen: np.ndarray) -> np.ndarray:
        """In which episodes a decisive obstacle was unseen when it counted.

        Args:
            seen: Of every event, shape (n, ...), bool.

        Returns:
            Shape (worlds, ...), bool.
        """
        result = np.zeros((self.worlds, *seen.shape[1:]), dtype=bool)
        np.logical_or.at(result, self.world, ~seen)
        return result


def find_events(record: Record, num_poses: int, options: SightOptions, period: float) -> Events:
    """Find the decisive obstacles of a record.

    Args:
        record: Of one seed.
        num_poses: Number of head poses.
        options: How long what was seen is known.
        period: Time between two observations [s].
    """
    world, slot = np.nonzero(record.on_course.any(axis=0))
    first = record.on_course[:, world, slot].argmax(axis=0)
    in_time = ~record.too_late[:, world, slot] & (np.arange(len(record.pos))[:, None] <= first)
    # The last of them; the very first observation where there is none.
    step = np.where(in_time.any(axis=0), len(in_time) - 1 - in_time[::-1].argmax(axis=0), 0)
    shows = bits_of(record.shown[:, world, slot], num_poses).transpose(1, 0, 2)
    pos = record.pos[:, world, slot].transpose(1, 0, 2)
    when = np.arange(len(record.pos))
    moved = np.linalg.norm(pos - pos[np.arange(len(step)), step][:, None], axis=-1)
    late = step[:, None] - when
    known = (late >= 0) & ((moved <= options.moved_m) | (late * period <= options.fresh_s + 1e-9))
    return Events(world, step, shows & known[..., None], record.running.shape[1])


def bits_of(words: np.ndarray, count: int) -> np.ndarray:
    """The first bits of words, (..., words) uint32 -> (..., count) bool; see `sight.look`."""
    bits = np.unpackbits(np.ascontiguousarray(words).view(np.uint8), axis=-1, bitorder="little")
    return bits[..., :count].astype(bool)


def held(events: Events) -> np.ndarray:
    """Which events a camera sees that is held at every pose, shape (n, npose)."""
    return np.asarray(events.shows.any(axis=1))


def anywhere(events: Events) -> np.ndarray:
    """Which events a camera sees that looks from all poses at once, shape (n,)."""
    return np.asarray(events.shows.any(axis=(1, 2)))


def look_around(events: Events, travel: np.ndarray, start: int) -> np.ndarray:
    """Which events a camera sees that knows them all and goes to where it sees most of them soon.

    At every observation it takes the pose where it would see most unseen decisive obstacles if it went there
    now and stayed, each worth the less the later it sees it. While the head moves it sees nothing.

    Args:
        events: All events.
        travel: Control steps that the head takes from a pose to another, shape (npose, npose), int.
        start: Pose at the start.

    Returns:
        Shape (n,).
    """
    seen = np.zeros(len(events.world), dtype=bool)
    for world in np.unique(events.world):
        rows = np.flatnonzero(events.world == world)
        seen[rows] = _look_around(events.shows[rows], travel, start)
    return seen


def _look_around(shows: np.ndarray, travel: np.ndarray, start: int) -> np.ndarray:
    count, steps, poses = shows.shape
    never = 10 * steps
    # The first step from each on at which a pose shows an event; a last row for what comes after the end.
    first = np.full((count, steps + 1, poses), never)
    for step in reversed(range(steps)):
        first[:, step] = np.where(shows[:, step], step, first[:, step + 1])
    seen = np.zeros(count, dtype=bool)
    step, pose = 0, start
    while step < steps and not seen.all():
        seen |= shows[:, step, pose]
        arrival = np.minimum(step + travel[pose], steps)
        when = first[~seen][:, arrival, np.arange(poses)]
        worth = np.where(when < never, _PATIENCE ** (when - step), 0.0).sum(axis=0)
        best = int(worth.argmax())
        if worth[best] <= worth[pose]:
            step += 1
        else:
            step, pose = int(arrival[best]), best
    return seen


def to_and_fro(events: Events, travel: np.ndarray, period: float) -> tuple[np.ndarray, tuple[int, int]]:
    """Which events a camera sees that only ever goes to and fro between two poses, the best two there are.

    It stays for `DWELL_S` at either, knows nothing, and sees nothing while it moves.

    Args:
        events: All events.
        travel: Control steps that the head takes from a pose to another, shape (npose, npose), int.
        period: Time between two observations [s].

    Returns:
        Shape (n,), and the two poses.
    """
    stay = round(DWELL_S / period)
    when = np.arange(events.shows.shape[1])
    by_travel = {}
    for steps in np.unique(travel):
        phase = when % (2 * (stay + steps))
        other = (phase >= stay + steps) & (phase < 2 * stay + steps)
        by_travel[steps] = tuple(events.shows[:, at].any(axis=1) for at in (phase < stay, other))
    one, two = (np.stack([by_travel[s][i] for s in by_travel]) for i in range(2))
    index = np.searchsorted(list(by_travel), travel)
    poses = np.arange(len(travel))
    fewest, best = np.inf, (0, 0)
    for pose in poses:
        seen = one[index[pose], :, pose].T | two[index[pose], :, poses].T
        failed = events.failed(seen).mean(axis=0)
        if failed.min() < fewest:
            fewest, best = failed.min(), (int(pose), int(failed.argmin()))
    pose, other = best
    return one[index[pose, other], :, pose] | two[index[pose, other], :, other], best


def join(parts: list[Events]) -> Events:
    """Put the events of several records side by side, worlds numbered one after the other."""
    longest = max(part.shows.shape[1] for part in parts)
    first = np.cumsum([0, *(part.worlds for part in parts)])
    padded = [np.pad(part.shows, ((0, 0), (0, longest - part.shows.shape[1]), (0, 0))) for part in parts]
    return Events(
        np.concatenate([part.world + offset for part, offset in zip(parts, first, strict=False)]),
        np.concatenate([part.step for part in parts]),
        np.concatenate(padded),
        int(first[-1]),
    )


def together(parts: list[Events]) -> Events:
    """Put different events of the same episodes together, each as long as the first ones."""
    return Events(
        np.concatenate([part.world for part in parts]),
        np.concatenate([part.step for part in parts]),
        np.concatenate([part.shows for part in parts]),
        parts[0].worlds,
    )


def of_worlds(events: Events, worlds: np.ndarray) -> Events:
    """The events of some episodes alone, numbered anew in their order.

    Args:
        events: All events.
        worlds: Which, shape (m,), int.
    """
    number = np.full(events.worlds, -1)
    number[worlds] = np.arange(len(worlds))
    rows = number[events.world] >= 0
    return Events(number[events.world[rows]], events.step[rows], events.shows[rows], len(worlds))
