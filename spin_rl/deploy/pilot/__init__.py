"""The pilot: what drives along with a policy by depth images, as guard and planner do in simulation."""
