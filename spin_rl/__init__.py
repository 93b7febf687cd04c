"""SPIN: simultaneous perception, interaction and navigation for a Stretch RE1 in MuJoCo Warp."""

__version__ = "0.1.0"
