"""Draw docs/figures/looking.png: where trained cameras look, a row for each result of analysis=camera.

Run from the repository root: ``python docs/figures/looking.py <result.json> ...``, results that
`spin-reproduce plan=active_camera` stored in results/active_camera_freeze, named <places>_free-<seed>.json.
"""

import argparse
import json
from pathlib import Path

from spin_rl.analysis.camera.drawing import draw_looking

OUT = Path("docs/figures/looking.png")


def main() -> None:
    """Draw one row below the other."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path, nargs="+")
    rows = []
    for file in parser.parse_args().results:
        result = json.loads(file.read_text())["result"]
        own = result["variants"][0]
        rows.append((f"{file.stem.partition('_')[0]}, success {own['mean_success']:.2f}", own["looking"]))
    draw_looking(rows, OUT)


if __name__ == "__main__":
    main()
