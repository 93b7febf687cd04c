"""Names of what makes the depth images of C MuJoCo, apart so that a command line can read them."""

from __future__ import annotations

RAYS, RENDERED = "multiray", "egl"
RENDERERS = (RAYS, RENDERED)
