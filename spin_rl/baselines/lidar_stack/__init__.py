"""A classical navigation stack (SPIN, Classical): lidar map, localization, planner and follower."""
