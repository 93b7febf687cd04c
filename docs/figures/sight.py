"""Draw docs/figures/sight.png: what constant head poses miss, a heat map for each result of analysis=sight.

Run from the repository root: ``python docs/figures/sight.py <result.json> ...``, results of ``spin-eval
analysis=sight out=<result.json>`` named <places>_<mount>.json.
"""

import argparse
import json
from pathlib import Path

from matplotlib.figure import Figure

OUT = Path("docs/figures/sight.png")
COLUMNS = 4


def main() -> None:
    """Draw all results side by side."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path, nargs="+")
    files = parser.parse_args().results
    rows = -(-len(files) // COLUMNS)
    figure = Figure(figsize=(12.0, 2.9 * rows), layout="constrained")
    grid = figure.subplots(rows, COLUMNS, squeeze=False, sharex=True, sharey=True).ravel()
    for axes, file in zip(grid, files, strict=False):
        result = json.loads(file.read_text())
        pans, tilts, group = result["sight"]["pans"], result["sight"]["tilts"], result["groups"][0]
        shares = list(zip(*group["unseen"], strict=True))
        axes.imshow(shares, origin="lower", vmin=0.0, vmax=1.0, cmap="magma_r", aspect="auto")
        axes.set_xticks(range(len(pans)), [f"{pan:.1f}" for pan in pans], fontsize=7)
        axes.set_yticks(range(len(tilts)), [f"{tilt:.2f}" for tilt in tilts], fontsize=7)
        held, _, around, _ = group["cameras"]
        pan, tilt = held["poses"][0]
        axes.plot(pans.index(pan), tilts.index(tilt), "o", mec="tab:green", mfc="none", ms=10, mew=2)
        name = file.stem.rpartition("_")[0].replace("_", " ")
        axes.set_title(
            f"{name}, {result['camera_mount']}\nbest constant {held['unseen']:.2f}, "
            f"looks around {around['unseen']:.2f}",
            fontsize=8,
        )
    for axes in grid[len(files) :]:
        axes.axis("off")
    figure.supxlabel("pan [rad]: 0 ahead, -1.57 right, -3.14 behind", fontsize=9)
    figure.supylabel("tilt [rad]: -1.5 at the wheels", fontsize=9)
    figure.colorbar(grid[0].images[0], ax=list(grid), label="episodes in which something decisive was unseen")
    figure.savefig(OUT, dpi=80)


if __name__ == "__main__":
    main()
