"""Whole fetches: to a table, pick, back, put down (SPIN, Table 1)."""
