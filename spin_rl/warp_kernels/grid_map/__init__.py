"""Occupancy grids of all worlds: building them from scans, matching scans, planning and driving in them."""
