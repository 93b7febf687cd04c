"""What tasks with an object to pick share: which it is, and where it is seen."""
