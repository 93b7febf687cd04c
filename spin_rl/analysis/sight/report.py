"""The sight analysis for people: terminal table, file of numbers and heat map."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

from spin_rl.benchmark.tables import reach as report
from spin_rl.files import write_atomically

BAR = 0.25
"""Difference to the best constant pose from which a family of places asks for a camera that moves."""


def table(result: dict[str, Any]) -> str:
    """Format a result of `analysis.analyse_sight` for the terminal."""
    sight = result["sight"]
    title = (
        f"Sight: {result['policy']} drives, {result['groups'][0]['episodes']} episodes, "
        f"robot {result['robot']}, camera {result['camera_mount']}, "
        f"{len(sight['pans']) * len(sight['tilts'])} constant poses"
    )
    header = ["places", "decisive", "camera", "pan, tilt", "unseen", "95%", "better by", "95%"]
    lines = [_line(group, camera) for group in result["groups"] for camera in group["cameras"]]
    notes = (
        "decisive: obstacles per episode that the robot would have touched within "
        f"{sight['lead_s']:g} s, had it gone on as it did",
        "unseen: share of the episodes in which one of them had not been seen by then",
        "better by: to the best constant pose, same episodes; looks around: knows what is decisive, a bound",
    )
    return "\n".join([title, *report.align([header, *lines]), *notes])


def _line(group: dict[str, Any], camera: dict[str, Any]) -> list[str]:
    first = camera["difference"] is None
    where = " / ".join(f"{pan:+.2f}, {tilt:+.2f}" for pan, tilt in camera["poses"])
    better = ["", ""]
    if not first:
        low, high = camera["difference"]["ci95"]
        better = [f"{camera['difference']['mean']:+.2f}", f"{low:+.2f} to {high:+.2f}"]
    return [
        group["name"] if first else "",
        f"{group['decisive']:.1f}" if first else "",
        "best constant" if first else camera["name"],
        where,
        f"{camera['unseen']:.2f}",
        "{:.2f}-{:.2f}".format(*camera["ci95"]),
        *better,
    ]


def headline(result: dict[str, Any]) -> str:
    """One line that sums a result up."""
    parts = []
    for group in result["groups"]:
        held, _, around, _ = group["cameras"]
        gain = around["difference"]["mean"]
        asks = "a camera must look around" if gain >= BAR else "a constant pose will do"
        parts.append(
            f"{group['name']}: unseen {held['unseen']:.2f}, looking around {around['unseen']:.2f}: {asks}"
        )
    return "; ".join(parts)


def write_csv(result: dict[str, Any], path: Path) -> None:
    """Write the share of every constant pose: places, pan, tilt [rad], unseen."""
    text = io.StringIO()
    rows = csv.writer(text)
    rows.writerow(("places", "pan", "tilt", "unseen"))
    for group in result["groups"]:
        for pan, shares in zip(result["sight"]["pans"], group["unseen"], strict=True):
            for tilt, share in zip(result["sight"]["tilts"], shares, strict=True):
                rows.writerow((group["name"], pan, tilt, share))
    write_atomically(path, lambda file: file.write(text.getvalue().encode()))


def plot(result: dict[str, Any], path: Path) -> None:
    """Draw a heat map over pan and tilt for each group of places.

    Args:
        result: Of `analysis.analyse_sight`.
        path: Image file to write; its folder is made.
    """
    from matplotlib.figure import Figure

    groups, sight = result["groups"], result["sight"]
    figure = Figure(figsize=(4.2 * len(groups) + 0.6, 3.4), layout="constrained")
    grid = figure.subplots(1, len(groups), squeeze=False)[0]
    for axes, group in zip(grid, groups, strict=True):
        axes.imshow(
            list(zip(*group["unseen"], strict=True)),
            origin="lower",
            vmin=0.0,
            vmax=1.0,
            cmap="magma_r",
            aspect="auto",
        )
        axes.set_xticks(range(len(sight["pans"])), [f"{pan:.1f}" for pan in sight["pans"]], fontsize=7)
        axes.set_yticks(range(len(sight["tilts"])), [f"{tilt:.2f}" for tilt in sight["tilts"]], fontsize=7)
        axes.set(xlabel="pan [rad], 0 ahead", ylabel="tilt [rad], negative is down")
        held, swing, around, _ = group["cameras"]
        pan, tilt = held["poses"][0]
        axes.plot(
            sight["pans"].index(pan),
            sight["tilts"].index(tilt),
            "o",
            mec="tab:green",
            mfc="none",
            ms=10,
            mew=2,
        )
        axes.set_title(
            f"{group['name']}, {result['camera_mount']}\nunseen: best constant {held['unseen']:.2f}, "
            f"to and fro {swing['unseen']:.2f}, looking around {around['unseen']:.2f}",
            fontsize=8,
        )
    figure.colorbar(grid[0].images[0], ax=list(grid), label="episodes with something unseen")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=90)
