"""Trained policies as ONNX files that say themselves how they are to be run."""
