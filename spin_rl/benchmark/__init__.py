"""The paper's benchmarks: episodes, metrics and reports beside its tables."""
