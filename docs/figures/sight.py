"""Draw docs/figures/sight.png: what constant head poses miss, of the stored results of analysis=sight.

Run from the repository root: ``python docs/figures/sight.py``.
"""

import json
from pathlib import Path

from matplotlib.figure import Figure

OUT = Path("docs/figures/sight.png")
RESULTS = (
    ("corridors", "sight/corridors"),
    ("corridors", "sight/corridors_landscape"),
    ("static beam", "active_camera_sight/static"),
    ("beam", "active_camera_sight/beam"),
    ("shuttle", "active_camera_sight/shuttle"),
    ("blind crossing", "active_camera_sight/crossing"),
    ("", "active_camera_sight/fetch"),
)
GROUPS = {"whole fetch": "whole fetch", "driving": "its driving alone", "object": "its object alone"}
COLUMNS = 5


def panels() -> list[tuple[str, dict, dict]]:
    """Return the heat maps: title, result, and the group of it."""
    found = []
    for places, name in RESULTS:
        result = json.loads(Path(f"results/{name}.json").read_text())["result"]
        camera = "wide camera" if result["camera_mount"] == "landscape" else "portrait"
        found += [(f"{places or GROUPS[g['name']]}, {camera}", result, g) for g in result["groups"]]
    return found


def main() -> None:
    """Draw all heat maps side by side."""
    drawn = panels()
    rows = -(-len(drawn) // COLUMNS)
    figure = Figure(figsize=(14.0, 2.9 * rows), layout="constrained")
    grid = figure.subplots(rows, COLUMNS, squeeze=False, sharex=True, sharey=True).ravel()
    for axes, (title, result, group) in zip(grid, drawn, strict=False):
        pans, tilts = result["sight"]["pans"], result["sight"]["tilts"]
        shares = list(zip(*group["unseen"], strict=True))
        axes.imshow(shares, origin="lower", vmin=0.0, vmax=1.0, cmap="magma_r", aspect="auto")
        axes.set_xticks(range(len(pans)), [f"{pan:.1f}" for pan in pans], fontsize=7)
        axes.set_yticks(range(len(tilts)), [f"{tilt:.2f}" for tilt in tilts], fontsize=7)
        held, _, around, _ = group["cameras"]
        pan, tilt = held["poses"][0]
        axes.plot(pans.index(pan), tilts.index(tilt), "o", mec="tab:green", mfc="none", ms=10, mew=2)
        axes.set_title(
            f"{title}\nbest constant {held['unseen']:.2f}, looks around {around['unseen']:.2f}", fontsize=9
        )
    for axes in grid[len(drawn) :]:
        axes.axis("off")
    figure.supxlabel("pan [rad]: 0 ahead, -1.57 right, -3.14 behind", fontsize=9)
    figure.supylabel("tilt [rad]: -1.5 at the wheels", fontsize=9)
    figure.colorbar(grid[0].images[0], ax=list(grid), label="episodes in which something decisive was unseen")
    figure.savefig(OUT, dpi=80)


if __name__ == "__main__":
    main()
