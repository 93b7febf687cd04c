"""Runs exported policies on a robot, or on one in C MuJoCo, with NumPy and onnxruntime alone.

Nothing here but `backends` may import Torch, Warp, MuJoCo or Hydra, directly or by what it imports: a test
blocks them.
"""
