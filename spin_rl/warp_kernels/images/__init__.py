"""Depth images as a real camera measures them, and their filter: noise, holes, smoothing."""
