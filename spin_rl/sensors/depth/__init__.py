"""The depth camera: exact images, noise, filter, and the filter on the robot."""
