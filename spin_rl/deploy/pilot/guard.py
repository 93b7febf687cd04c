"""The guard: a command that would end in what was seen gives way to the nearest that does not.

As `warp_kernels.guard`. Source: the dynamic window approach (Fox, Burgard and Thrun 1997), as a filter.
"""

from __future__ import annotations

import numpy as np

from spin_rl.deploy.pilot.trial import Trial

BACK_M_S = 0.2
"""Speed that is tried backwards [m/s]."""
_SHARES = (1.0, 0.75, 0.5, 0.25, 0.0)
"""Of the commanded speed, that are tried."""
_TURNS = 0.25 * np.arange(-4, 5)
"""Changes of the turning speed that are tried, shares of the limit."""
_TURN_COST = 0.7
"""How unlike a command another turning speed makes it, the forward speed counting 1."""
_AT_ONCE = 18
"""Commands that are tried together."""


def filtered(command: np.ndarray, steps: int, trial: Trial) -> np.ndarray:
    """Return the command most like a given one that hits nothing.

    It looks ahead less where none does; at last it is a stop.

    Args:
        command: Forward [m/s] and turning [rad/s], shape (2,).
        steps: Steps that it is driven before it brakes.
        trial: Tries them.

    Returns:
        A command likewise; the given one itself where it hits nothing.
    """
    if trial.is_free(command[None], steps)[0]:
        return command
    ahead, back, turn = trial.drive.most
    speeds = np.array([*(share * command[0] for share in _SHARES), -min(back, BACK_M_S)])
    turns = np.clip(command[1] + turn * _TURNS, -turn, turn)
    tried = np.stack(np.meshgrid(speeds, turns, indexing="ij"), -1).reshape(-1, 2)
    cost = np.abs(tried - command) @ (1.0 / ahead, _TURN_COST / turn)
    tried = tried[np.argsort(cost, kind="stable")]
    for looked in range(steps, 0, -2):
        for first in range(0, len(tried), _AT_ONCE):
            some = tried[first : first + _AT_ONCE]
            is_free = trial.is_free(some, looked)
            if is_free.any():
                return some[is_free.argmax()]
    return np.zeros(2)
