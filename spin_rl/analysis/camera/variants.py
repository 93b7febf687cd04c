"""Ways to use the camera that the camera analysis compares."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from omegaconf import OmegaConf

from spin_rl import robot
from spin_rl.benchmark.reach import REACH_CELLS, Cell
from spin_rl.config import ConfigError
from spin_rl.paths import CONF_DIR
from spin_rl.scenes.kinds import DIFFICULTIES, SCENARIOS

SAMPLED = "sampled"
"""Kind of variant whose camera's actions are drawn."""


@dataclass(frozen=True)
class Variant:
    """One way to use the camera.

    Attributes:
        name: For tables.
        kind: `own`, `sampled` (its actions drawn as in training), `frozen` (at the own mean pose), `fixed`
            (given) or `blind` (the control).
        pose: Pan and tilt [rad] at which the camera is held; None leaves it as the policy was configured.
    """

    name: str
    kind: str
    pose: tuple[float, float] | None = None


def held_variants(tilts: Sequence[float], blind: Sequence[float] | None) -> list[Variant]:
    """List the poses to hold the camera at: a sweep of tilts at pan 0, the FixCam poses, and the control.

    Args:
        tilts: Tilts of the sweep [rad]; none leave out the FixCam poses too, for the freeze test alone.
        blind: Pan and tilt [rad] that show nothing of use: a policy that succeeds there does not look.

    Returns:
        Variants from the highest to the lowest tilt, each pose once, then the control.
    """
    named = fixcam_poses() if tilts else {}
    poses = sorted({*named, *((0.0, float(tilt)) for tilt in tilts)}, key=lambda pose: (-pose[1], pose[0]))
    result = []
    for pan, tilt in poses:
        where = f"tilt {tilt:.2f}" if pan == 0.0 else f"pan {pan:.2f}, tilt {tilt:.2f}"
        fixcam = named.get((pan, tilt))
        result.append(Variant(f"{where} (FixCam {fixcam})" if fixcam else where, "fixed", (pan, tilt)))
    if blind is not None:
        result.append(Variant("blind control", "blind", (float(blind[0]), float(blind[1]))))
    return result


def sampled_variant() -> Variant:
    """The camera as in training: what exploration alone shows."""
    return Variant("own camera, its actions drawn", SAMPLED)


def fixcam_poses() -> dict[tuple[float, float], str]:
    """Read the poses of the FixCam baseline, (pan, tilt) [rad] -> I to IV."""
    files = sorted((CONF_DIR / "camera").glob("fixcam_*.yaml"))
    return {tuple(OmegaConf.load(file).task.camera_pose): file.stem.removeprefix("fixcam_") for file in files}


def parse_cells(names: Sequence[str]) -> tuple[Cell, ...]:
    """Turn names such as `2-hard` into cells.

    Raises:
        ConfigError: There is no such cell, or one appears twice.
    """
    cells = []
    for name in names:
        match = re.fullmatch(r"(\d)-(\w+)", str(name))
        cell = Cell(int(match[1]), match[2]) if match else None
        if cell not in REACH_CELLS:
            known = ", ".join(f"{scenario}-{level}" for scenario in SCENARIOS for level in DIFFICULTIES)
            raise ConfigError(f"camera_analysis.cells: unknown cell {name!r}; choose from {known}")
        cells.append(cell)
    if not cells or len(set(cells)) < len(cells):
        raise ConfigError(f"camera_analysis.cells: expected cells, each once, got {list(names)}")
    return tuple(cells)


def check_pose(variant: Variant) -> None:
    """Reject a pose that the head cannot take.

    Raises:
        ConfigError: An angle is beyond its joint's limits.
    """
    if variant.pose is None:
        return
    for joint, value in zip(robot.CAMERA_JOINTS, variant.pose, strict=True):
        index = robot.JOINTS.index(joint)
        low, high = robot.JOINT_LOWER[index], robot.JOINT_UPPER[index]
        if not low <= value <= high:
            raise ConfigError(f"camera_analysis: {variant.name}: {joint} {value} is outside [{low}, {high}]")
