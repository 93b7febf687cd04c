"""Corridors with a table at their end, for whole fetches."""
