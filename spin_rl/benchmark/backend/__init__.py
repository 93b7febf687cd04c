"""Benchmarks in another simulator: each episode of the batched run once more, by itself, and paired with it."""
