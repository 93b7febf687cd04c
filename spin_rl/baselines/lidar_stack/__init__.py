"""A classical navigation stack (SPIN, Classical): a lidar map, localization in it, a planner and a follower."""
