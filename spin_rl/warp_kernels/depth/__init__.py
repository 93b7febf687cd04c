"""Exact depth images: geoms become records, records are drawn at the pixels."""
