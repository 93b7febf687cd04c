"""The benchmarks for people: tables beside the paper's figures, and JSON."""
