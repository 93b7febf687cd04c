"""The comparison with the paper: its trainings and evaluations, what of them is done, and running the rest."""
