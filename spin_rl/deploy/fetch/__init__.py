"""Whole fetches on a robot: two exported policies, scripts between them, and what leads from one to the next.

The same as `spin_rl.tasks.fetch`, which says why, for one robot and without Warp; a test holds the two
together.
"""
