"""The comparison with the paper: its trainings and evaluations, what is done of them, running the rest."""
