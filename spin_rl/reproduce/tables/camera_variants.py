"""What the camera analysis measured of trainings: the camera held at its mean pose, or its actions drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from spin_rl.reproduce.tables.stored import Measured

_LABELS = {"frozen": "frozen at its mean", "sampled": "its actions drawn as in training"}
"""What is done with the camera, by the kind of variant."""


def variant_rows(group: str, camera: str, analysed: Measured) -> list[tuple[str, ...]]:
    """Rows of the variants that were measured.

    Args:
        group: Kind of places.
        camera: The trainings' own, such as `free`.
        analysed: Results of the camera analysis, one a training.

    Returns:
        Places, camera, success, that of each training, collisions, time-outs, what the policy's own camera
        has more in the same scenes, and the trainings.
    """
    rows = []
    for kind, found in _variants(analysed).items():
        rates = [variant["mean_success"] for variant in found]
        lost = [variant["difference"] for variant in found]
        intervals = [f"{-d['mean']:+.2f} ({-d['ci95'][1]:+.2f} to {-d['ci95'][0]:+.2f})" for d in lost]
        rows.append(
            (
                group,
                f"{camera}, {_LABELS[kind]}",
                f"{sum(rates) / len(rates):.2f}",
                " ".join(f"{rate:.2f}" for rate in rates),
                _mean(found, "collision_rate"),
                _mean(found, "timeout_rate"),
                "; ".join(intervals),
                analysed.steps,
            )
        )
    return rows


def variant_records(group: str, camera: str, analysed: Measured) -> list[dict[str, Any]]:
    """The same for machines; see `variant_rows`."""
    return [
        {
            "places": group,
            "camera": f"{camera}, {_LABELS[kind]}",
            "success_rate": sum(variant["mean_success"] for variant in found) / len(found),
            "each_training": " ".join(f"{variant['mean_success']:.4f}" for variant in found),
            "difference": -sum(variant["difference"]["mean"] for variant in found) / len(found),
            "trainings": analysed.steps,
        }
        for kind, found in _variants(analysed).items()
    ]


def motion_lines(analysed: Measured) -> Sequence[str]:
    """How the trainings' own cameras move, a line each."""
    lines = []
    for result, training in zip(analysed.results, analysed.trainings, strict=True):
        camera = result["result"]["variants"][0]["camera"]
        parts = [
            f"{joint} {motion['p5']:+.2f} to {motion['p95']:+.2f} rad, std within an episode "
            f"{motion['std_within']:.2f}"
            for joint, motion in camera.items()
        ]
        lines.append(f"camera of {training['name']} (5-95 %): {'; '.join(parts)}")
    return lines


def _variants(analysed: Measured) -> dict[str, list[Mapping[str, Any]]]:
    """Entries of each kind that every training has, of those that have a label."""
    of_each = [{v["kind"]: v for v in result["result"]["variants"]} for result in analysed.results]
    return {kind: [of[kind] for of in of_each] for kind in _LABELS if all(kind in of for of in of_each)}


def _mean(variants: Sequence[Mapping[str, Any]], key: str) -> str:
    values = [row[key] for variant in variants for row in variant["rows"]]
    return f"{sum(values) / len(values):.2f}"
