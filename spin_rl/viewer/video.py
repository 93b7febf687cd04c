"""Writing a video of a policy: .mp4 by ffmpeg, .gif by Pillow."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from spin_rl.config import ConfigError
from spin_rl.extras import require
from spin_rl.viewer import style
from spin_rl.viewer.rollout import Player
from spin_rl.viewer.snapshot import Snapshot

FORMATS = (".mp4", ".gif")

_HOLD_S = 0.8  # the last picture of an episode stays, so that its outcome can be read
_GIF_WIDTH = 480
_GIF_COLOURS = 96
_PALETTE_SAMPLES = 12
_GIF_KEPT = 8  # of 255, less than tiles of the floor differ

Append = Callable[[Image.Image], None]


def check_video(path: Path) -> None:
    """Find out before a long rendering whether its result can be written.

    Raises:
        ConfigError: Another format, a folder, a place that cannot be written to, or a missing package.
    """
    if path.suffix not in FORMATS:
        raise ConfigError(f"video: {path} should end in {' or '.join(FORMATS)}")
    if path.is_dir():
        raise ConfigError(f"video: {path} is a folder")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"video: cannot make the folder {path.parent}: {error.strerror}") from None
    if not os.access(path.parent, os.W_OK):
        raise ConfigError(f"video: cannot write to the folder {path.parent}")
    if path.suffix == ".mp4":
        require("imageio_ffmpeg", "imageio[ffmpeg]", "viewer", "video")


@contextlib.contextmanager
def open_video(path: Path, fps: float) -> Iterator[Append]:
    """Write pictures of one size to a video; the file appears when all of them are written.

    Args:
        path: With the suffix .mp4 or .gif.
        fps: Pictures per second.

    Yields:
        A function that adds a picture.
    """
    partial = path.with_name(f".{path.stem}.partial{path.suffix}")
    try:
        with (_mp4 if path.suffix == ".mp4" else _gif)(partial, fps) as append:
            yield append
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


@contextlib.contextmanager
def _mp4(path: Path, fps: float) -> Iterator[Append]:
    imageio = require("imageio.v2", "imageio[ffmpeg]", "viewer", "video")
    writer = imageio.get_writer(
        path, format="FFMPEG", fps=fps, codec="libx264", quality=7, ffmpeg_log_level="error"
    )
    try:
        yield lambda picture: writer.append_data(np.asarray(picture))
    finally:
        writer.close()


@contextlib.contextmanager
def _gif(path: Path, fps: float) -> Iterator[Append]:
    pictures: list[Image.Image] = []

    def append(picture: Image.Image) -> None:
        height = round(picture.height * _GIF_WIDTH / picture.width)
        pictures.append(picture.resize((_GIF_WIDTH, height), Image.Resampling.LANCZOS))

    yield append
    frames = _frames(pictures)
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=round(1000 / fps), loop=0)


def _frames(pictures: list[Image.Image]) -> list[Image.Image]:
    """Frames that differ only where something moves: one palette, no dithering, and no slight changes."""
    palette = _palette(pictures)
    entries = palette.getpalette() or []
    colours = np.array(entries).reshape(-1, 3)
    frames, shown = [], None
    for picture in pictures:
        indices = np.asarray(picture.quantize(palette=palette, dither=Image.Dither.NONE))
        if shown is not None:
            change = np.abs(np.asarray(picture).astype(int) - colours[shown]).max(-1)
            indices = np.where(change <= _GIF_KEPT, shown, indices)
        shown = indices
        frame = Image.fromarray(indices)
        frame.putpalette(entries)
        frames.append(frame)
    return frames


def _palette(pictures: list[Image.Image]) -> Image.Image:
    """An image whose palette suits all pictures: their commonest colours, and those that mean something."""
    count = min(len(pictures), _PALETTE_SAMPLES)
    width, height = pictures[0].size
    samples = Image.new("RGB", (width, height * count))
    for i in range(count):
        samples.paste(pictures[i * (len(pictures) - 1) // max(count - 1, 1)], (0, i * height))
    common = samples.quantize(_GIF_COLOURS, dither=Image.Dither.NONE).getpalette() or []
    # Small things would lose their colours to the floor's many shades.
    meant = [*style.LEVEL.values(), *style.OUTCOME.values(), style.SEEN, style.FRUSTUM]
    shades = [round(shade * channel) for colour in meant for shade in (1.0, 0.75, 0.5) for channel in colour]
    palette = Image.new("P", (1, 1))
    palette.putpalette(common[: 3 * _GIF_COLOURS] + shades)
    return palette


def record(
    player: Player,
    episodes: int,
    draw: Callable[[Snapshot], Image.Image],
    append: Append,
    *,
    report: Callable[[str], None] = print,
) -> list[list[Snapshot]]:
    """Play whole episodes of world 0 and draw every control step.

    Args:
        player: At the start of an episode.
        episodes: How many.
        draw: Makes a picture of a snapshot.
        append: Takes the pictures.
        report: Receives lines of progress.

    Returns:
        The snapshots of every episode.
    """
    hold = round(_HOLD_S / player.env.cfg.sim.control_period)
    start = last = time.monotonic()
    recorded = []
    for episode in play(player, episodes):
        trace = []
        for snapshot in episode:
            picture = draw(snapshot)
            for _ in range(1 + hold * snapshot.ended):
                append(picture)
            trace.append(snapshot)
            now = time.monotonic()
            if now - last > 10.0:
                last = now
                report(
                    f"  episode {len(recorded) + 1} of {episodes}, {snapshot.time:.1f} s drawn "
                    f"after {now - start:.0f} s"
                )
        recorded.append(trace)
    return recorded


def play(player: Player, episodes: int) -> Iterator[Iterator[Snapshot]]:
    """Iterate over episodes of world 0, and each over its snapshots; exhaust one before the next."""
    for _ in range(episodes):
        yield _episode(player)


def _episode(player: Player) -> Iterator[Snapshot]:
    snapshot = player.snapshots[0]
    yield snapshot
    while not snapshot.ended:
        snapshot = player.step()[0]
        yield snapshot
