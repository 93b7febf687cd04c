"""Why episodes fail: what touched what, when, and whether it had been seen."""
