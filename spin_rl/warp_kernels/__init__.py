"""Warp kernels on plain arrays: geometry, visibility, scandots, contacts, depth images, distance fields.

Importing it starts Warp quietly: without its banner, its line for every module that it loads, and its warning
that there is no GPU. Whoever wants them sets `warp.config.log_level` before.
"""

from __future__ import annotations

import os

import warp as wp

from spin_rl.machine import has_gpu_driver


def _start_quietly() -> None:
    if wp.config.log_level == wp.LOG_INFO:  # Warp's own; any other was chosen
        wp.config.log_level = wp.LOG_WARNING
    if has_gpu_driver():
        return
    # The warning is written by C, so that the descriptor itself has to be turned elsewhere.
    try:
        terminal = os.dup(2)
    except OSError:  # there is no standard error
        wp.init()
        return
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 2)
        try:
            wp.init()
        finally:
            os.dup2(terminal, 2)
            os.close(terminal)


_start_quietly()
