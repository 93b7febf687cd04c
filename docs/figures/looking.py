"""Draw docs/figures/looking.png: where the free cameras look, a training of each kind of places.

Run from the repository root: ``python docs/figures/looking.py``.
"""

import json
from pathlib import Path

from spin_rl.analysis.camera.drawing import draw_looking

OUT = Path("docs/figures/looking.png")
RESULTS = Path("results/active_camera_freeze")
PLACES = ("static", "beam", "shuttle", "crossing")


def main() -> None:
    """Draw one row below the other."""
    rows = []
    for places in PLACES:
        result = json.loads((RESULTS / f"{places}_free-1.json").read_text())["result"]
        own = result["variants"][0]
        rows.append((f"{places}, success {own['mean_success']:.2f}", own["looking"]))
    draw_looking(rows, OUT)


if __name__ == "__main__":
    main()
