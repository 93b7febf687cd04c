"""Straight and L-shaped corridors with clutter, generated on the device (SPIN, Training environments)."""
