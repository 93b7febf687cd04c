"""The mujoco-warp bridge: batched model, masked reset, graph capture and zero-copy Torch views."""

from spin_rl.sim.simulation import SimConfig, Simulation

__all__ = ["SimConfig", "Simulation"]
