"""Picking an object from a table (SPIN 2.1.1)."""
