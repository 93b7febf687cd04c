"""Turn a video into a picture for the documentation: docs/figures/animation.py IN.mp4 OUT.webp [WIDTH].

WebP holds all colours at about the size of a GIF, and GitHub and browsers play it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import imageio.v2 as imageio
from PIL import Image

WIDTH = 800
QUALITY = 60
STEP_MS = 100  # a video has a picture for every control step


def main() -> None:
    """Write the picture that the second argument names."""
    pictures = [Image.fromarray(frame) for frame in imageio.mimread(Path(sys.argv[1]), memtest=False)]
    width = int(sys.argv[3]) if len(sys.argv) > 3 else WIDTH
    height = round(pictures[0].height * width / pictures[0].width)
    frames = [picture.resize((width, height), Image.Resampling.LANCZOS) for picture in pictures]
    frames[0].save(
        sys.argv[2],
        save_all=True,
        append_images=frames[1:],
        duration=STEP_MS,
        loop=0,
        quality=QUALITY,
        method=4,
    )


if __name__ == "__main__":
    main()
