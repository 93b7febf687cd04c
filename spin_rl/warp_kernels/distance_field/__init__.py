"""Length of the shortest passable way to a goal: obstacles become cells, values spread from the goal."""
