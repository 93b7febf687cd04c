"""A guard between policy and base, by what was seen: command filter and the way out of where it is stuck."""
