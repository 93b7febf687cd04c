"""Tasks as rsl_rl vector environments over the batched simulation."""
