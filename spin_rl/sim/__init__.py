"""The mujoco-warp bridge: batched model, masked reset, graph capture and zero-copy Torch views."""
