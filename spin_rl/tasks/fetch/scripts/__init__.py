"""What the robot does by itself in a fetch, between its two policies."""
