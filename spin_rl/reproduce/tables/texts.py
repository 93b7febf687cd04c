"""The title of every table, and its two sentences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class Text:
    """What stands over a table.

    Attributes:
        title: What it shows.
        about: At most two sentences in Markdown, with links from docs/.
    """

    title: str
    about: str


TEXTS: Mapping[str, Text] = MappingProxyType(
    {
        "1": Text(
            "Table 1, reach: success and time in the paper's six corridors",
            "The paper's five methods, trained from scratch with the same samples, and Mapping also with "
            "maps of other errors, in this project's reading of the paper's corridors "
            "([what differs](paper_deviations.md)). NoPointNet has not learned the task with these samples "
            "([why](experiments.md#why-is-nopointnet-so-far-behind)), and a map's errors are larger than "
            "the room beside the robot ([how](experiments.md#why-is-a-noisy-map-worse-than-a-camera)).",
        ),
        "place": Text(
            "Table 1, pick and place: success in whole fetches",
            "Policies of the table above drive, and one shipped policy picks in all rows, with a camera that "
            "moves. FixCam has no row: fetches [with one pose](active_camera.md#one-pose-for-a-whole-fetch)"
            " are another comparison, with policies that were trained for it.",
        ),
        "fixcam": Text(
            "FixCam: success with the camera frozen in each of the paper's poses",
            "Every pose was trained in, beside a camera that moves, in the mount of the real robot and in "
            "the paper's. The gap is smaller than the paper's since [one pose shows nearly all that "
            "matters](active_camera.md#what-was-found) in a corridor: held at tilt -0.7, none of the paper's "
            "four, the camera misses nothing decisive, and does better than the one that moves.",
        ),
        "visibility": Text(
            "Visibility range: success and distance to the goal at the end, all six corridors",
            "The range is half the side of the square window in which obstacles are told. The paper "
            "explains its loss at 5 m by a robot that stalls, which would show as time-outs here.",
        ),
        "dynamic": Text(
            "Static and dynamic obstacles: success within 15 cm, and collisions of an episode",
            "Simulated counterparts of the paper's two real places "
            "([how](baselines.md#the-dynamic-benchmark)), where an episode goes on after a collision. The "
            "learned policies are shipped ones, with and without the guard and planner that the paper does "
            "not have; the classical stack maps, localizes, plans and follows.",
        ),
        "depth": Text(
            "Scandots against depth images: steps a second, and success after a training of some minutes",
            "Reinforcement learning straight from depth images beside learning from scandots. Simulated "
            "steps are those of the environment alone, trained ones come with the learning.",
        ),
        "active_camera": Text(
            "A camera that moves against constant poses that were trained in",
            "Not of the paper: [places in which one pose does not show enough](active_camera.md). A camera "
            "that moves is worth its motors there if it beats every constant pose by 15 points.",
        ),
    }
)
"""Value of `table=` -> its text."""
