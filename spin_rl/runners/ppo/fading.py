"""PPO with a supervised loss that fades out: it helps at first, and shall not hold the policy in the end."""

from __future__ import annotations

from spin_rl.runners.ppo.algorithm import PPO


class FadingPPO(PPO):
    """PPO that knows how much of a supervised loss is left; subclasses add the loss and say how it fades.

    Attributes:
        fading_loss: Weight of the loss at the start.
        fading_part: Part of the run over which that weight falls to zero, linearly.
        progress: Part of the run that is over.
    """

    fading_loss: float = 0.0
    fading_part: float = 1.0
    progress: float = 0.0

    @property
    def imitation_weight(self) -> float:
        """Current weight of the supervised loss."""
        return self.fading_loss * max(0.0, 1.0 - self.progress / self.fading_part)

    def set_progress(self, progress: float) -> None:
        """Take note of the part of the run that is over; it never falls, as when a run is resumed."""
        super().set_progress(progress)
        self.progress = max(self.progress, min(progress, 1.0))

    def extra_state(self) -> dict[str, float]:
        """Return how far the supervised loss has faded."""
        return {"progress": self.progress}

    def load_extra_state(self, state: dict[str, float]) -> None:
        """Restore it."""
        self.progress = state["progress"]
