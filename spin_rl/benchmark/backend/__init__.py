"""Benchmarks in another simulator: episodes of the batched run once more, each by itself, in pairs."""
