"""Warp kernels on plain arrays: scandot tokens, depth, contact flags. Imports only warp and mujoco_warp."""
