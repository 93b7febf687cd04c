"""Throughput of sensors, environment and training, beside peers measured in the same run."""
