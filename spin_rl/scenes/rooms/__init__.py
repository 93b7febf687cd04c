"""Families of places to drive in, mixed by shares and generated on the device."""
