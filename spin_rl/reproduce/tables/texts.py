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
            "The paper's five methods, trained from scratch with the same samples (DVO's two phases have "
            "half of them each, and it lags), and Mapping also with maps of other errors, in this "
            "project's reading of the paper's corridors ([what differs](paper_deviations.md)). NoPointNet "
            "has not learned the task with these samples "
            "([why](experiments.md#why-is-nopointnet-so-far-behind)), and a map's errors are larger than "
            "the room beside the robot ([how](experiments.md#why-is-a-noisy-map-worse-than-a-camera)).",
        ),
        "place": Text(
            "Table 1, pick and place: success in whole fetches",
            "Policies of the table above drive, and one shipped policy picks in all rows, with a camera "
            "that moves. So FixCam has the paper's row alone: fetches [with one "
            "pose](active_camera_comparison.md#one-pose-for-a-whole-fetch) are another comparison, of "
            "policies that were trained for it.",
        ),
        "fixcam": Text(
            "FixCam: success with the camera frozen in each of the paper's poses",
            "Every pose was trained in, beside a camera that moves: in portrait, as on the real robot, "
            "and IV also in landscape, as the paper's 87 by 58 degrees can be read. Pose IV [misses "
            "something decisive](sight_analysis.md#what-was-found) in 23 % of the corridors in landscape "
            "and in 8 % in portrait; in portrait the pose that the screening finds misses nothing, and "
            "does better than a camera that moves.",
        ),
        "visibility": Text(
            "Visibility range: success and distance to the goal at the end, all six corridors",
            "The range is half the side of the square window in which obstacles are told. The paper "
            "explains its loss at 5 m by a robot that stalls: here one of two trainings at 3 m and one at "
            "5 m lose 8 points on hard, less than half of it by time-outs, and the others hardly "
            "anything.",
        ),
        "dynamic": Text(
            "Static and dynamic obstacles: success within 15 cm, and collisions of an episode",
            "Simulated counterparts of the paper's two real places "
            "([how](baselines.md#the-dynamic-benchmark)), where an episode goes on after a collision. The "
            "learned policies are shipped ones, with and without the guard and planner that the paper "
            "does not have; the classical stack maps, localizes, plans and follows, and by its map alone "
            "it breaks with dynamic obstacles as the paper's does.",
        ),
        "depth": Text(
            "Scandots against depth images: steps a second, and success after a training of some minutes",
            "Reinforcement learning straight from depth images beside learning from scandots: unlike the "
            "paper's it does learn, but slower, by samples and more so by time. Simulated steps are those "
            "of the environment alone, trained ones come with the learning.",
        ),
        "active_camera": Text(
            "A camera that moves against constant poses that were trained in",
            "Not of the paper: [places in which one pose does not show enough](active_camera.md). A "
            "camera that moves is worth its motors there if it beats every constant pose by 15 points, but "
            "those were trained [with other PPO settings](active_camera_comparison.md#the-comparison), "
            "which costs some of them up to 18.",
        ),
    }
)
"""Value of `table=` -> its text."""
