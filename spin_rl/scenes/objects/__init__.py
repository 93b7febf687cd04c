"""The five objects to pick up: shapes, mass and friction."""
