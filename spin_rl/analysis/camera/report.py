"""The camera analysis for people: terminal table and plot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from spin_rl.analysis.camera.drawing import draw_looking
from spin_rl.analysis.episodes import condition_of
from spin_rl.benchmark.metrics import wilson_interval
from spin_rl.benchmark.tables import reach as report
from spin_rl.scenes.kinds import DIFFICULTIES


def table(result: dict[str, Any]) -> str:
    """Format a result of `camera.analyse_camera` for the terminal."""
    variants = result["variants"]
    seeds = ", ".join(str(seed) for seed in result["seeds"])
    title = (
        f"Camera: {result['policy']}, {variants[0]['rows'][0]['episodes']} episodes per cell "
        f"(seeds {seeds}), robot {result['robot']}, camera {result['camera_mount']}"
        f"{report.conditions_note(result)}"
    )
    header = [
        "camera",
        *map(condition_of, result["cells"]),
        "mean",
        "to own",
        "95%",
        "won/lost",
        "obstacle hits",
        "never seen",
    ]
    lines = report.align([header, *(_line(variant) for variant in variants)])
    notes = (
        "to own: paired difference of the mean success, same places; won/lost: places that only "
        "this or only the own camera solved",
        "never seen: share of the obstacle hits where no corner of the obstacle had been visible before",
    )
    return "\n".join([title, *_motion(variants[0]), *lines, *notes])


def _line(variant: dict[str, Any]) -> list[str]:
    rates = [f"{row['success_rate']:.2f}" for row in variant["rows"]]
    difference, hits = variant["difference"], variant["hits"]
    compared = ["", "", ""]
    if difference is not None:
        low, high = difference["ci95"]
        compared = [
            f"{difference['mean']:+.2f}",
            f"{low:+.2f} to {high:+.2f}",
            f"{difference['won']}/{difference['lost']}",
        ]
    share = hits["never_seen_share"]
    unseen = "-" if share is None else f"{share:.0%}"
    mean = f"{variant['mean_success']:.2f}"
    return [variant["name"], *rates, mean, *compared, str(hits["obstacle_hits"]), unseen]


def _motion(own: dict[str, Any]) -> list[str]:
    lines = []
    for joint, motion in own["camera"].items():
        lines.append(
            f"  own {joint:4} mean {motion['mean']:+.2f} rad, "
            f"5-95% {motion['p5']:+.2f} to {motion['p95']:+.2f}, "
            f"std {motion['std']:.2f} ({motion['std_within']:.2f} within an episode), "
            f"moves {motion['rate']:.2f} rad/s"
        )
    return lines


def headline(result: dict[str, Any]) -> str:
    """One line that sums a result up."""
    variants = result["variants"]
    own, frozen = variants[0], variants[1]
    low, high = frozen["difference"]["ci95"]
    parts = [
        f"mean success {own['mean_success']:.2f}",
        f"frozen at its mean {frozen['mean_success']:.2f} ({low:+.2f} to {high:+.2f})",
    ]
    fixed = [variant for variant in variants if variant["kind"] == "fixed"]
    if fixed:
        best = max(fixed, key=lambda variant: variant["mean_success"])
        parts.append(f"best fixed {best['name']} {best['mean_success']:.2f}")
    parts += [f"blind {v['mean_success']:.2f}" for v in variants if v["kind"] == "blind"]
    return ", ".join(parts)


def plot(result: dict[str, Any], path: Path) -> None:
    """Draw success over tilt, and where the policy's own camera looks, in `<path>_looking`.

    Args:
        result: Of `camera.analyse_camera`.
        path: Image file to write; its folder is made.
    """
    _plot_success(result, path)
    own = result["variants"][0]
    if "looking" in own:
        draw_looking([(result["policy"], own["looking"])], path.with_stem(f"{path.stem}_looking"))


def _plot_success(result: dict[str, Any], path: Path) -> None:
    """Draw the sweep, the FixCam poses, and the policy's own camera."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 4.5), layout="constrained")
    axes = figure.add_subplot()
    variants = result["variants"]
    sweep = [v for v in variants if v["kind"] == "fixed" and v["camera_pose"][0] == 0.0]
    tilts = [v["camera_pose"][1] for v in sweep]
    for i, cell in enumerate(result["cells"]):
        rates = [v["rows"][i]["success_rate"] for v in sweep]
        label = condition_of(cell)
        style = "--" if cell.get("scenario") == 2 else "-"
        color = f"C{DIFFICULTIES.index(cell['difficulty']) if 'difficulty' in cell else i}"
        axes.plot(tilts, rates, style, color=color, linewidth=0.8, alpha=0.7, label=label)
    axes.errorbar(
        tilts,
        [v["mean_success"] for v in sweep],
        yerr=_error_bars(sweep),
        color="black",
        marker="o",
        capsize=3,
        label="held at pan 0: mean",
    )
    for variant in sweep:
        if "(" in variant["name"]:
            text = variant["name"].partition("(")[2].rstrip(")")
            tilt, top = variant["camera_pose"][1], axes.get_xaxis_transform()
            axes.axvline(tilt, color="0.85", linewidth=0.8, zorder=0)
            # Above the frame, where no error bar comes.
            axes.text(tilt, 1.01, text, transform=top, rotation=90, fontsize=7, ha="center", va="bottom")
    own, frozen = variants[0], variants[1]
    motion = own["camera"]["tilt"]
    axes.errorbar(
        [motion["mean"]],
        [own["mean_success"]],
        xerr=[[motion["mean"] - motion["p5"]], [motion["p95"] - motion["mean"]]],
        yerr=_error_bars([own]),
        color="tab:red",
        marker="*",
        markersize=12,
        capsize=3,
        label="own camera (tilt: mean, 5-95%)",
    )
    pan, tilt = frozen["camera_pose"]
    axes.errorbar(
        [tilt],
        [frozen["mean_success"]],
        yerr=_error_bars([frozen]),
        color="tab:blue",
        marker="D",
        capsize=3,
        label=f"frozen at own mean (pan {pan:.2f})",
    )
    for variant in variants:
        if variant["kind"] == "blind":
            axes.axhline(variant["mean_success"], color="0.5", linestyle=":", label="blind control")
    axes.set(xlabel="camera tilt [rad], negative is down", ylabel="success rate", ylim=(-0.02, 1.02))
    figure.suptitle(f"{result['policy']}, {own['rows'][0]['episodes']} episodes per cell", fontsize=10)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)


def _error_bars(variants: list[dict[str, Any]]) -> list[list[float]]:
    """Wilson intervals of the success over all cells, as lengths below and above, shape (2, n)."""
    below, above = [], []
    for variant in variants:
        count = sum(row["episodes"] for row in variant["rows"])
        low, high = wilson_interval(round(variant["mean_success"] * count), count)
        below.append(max(variant["mean_success"] - low, 0.0))
        above.append(max(high - variant["mean_success"], 0.0))
    return [below, above]
