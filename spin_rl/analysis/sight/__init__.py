"""Which obstacles a held camera and one that looks around would have shown in time."""
