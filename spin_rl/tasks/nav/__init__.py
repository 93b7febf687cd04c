"""Navigation: drive through clutter to a goal (SPIN 2.1.2)."""
