"""The paper's tables, its figures beside ours, made of stored results; `spin-eval table=<name>`."""
