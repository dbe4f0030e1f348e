"""Geometry of arms in a picture: directions, rotations, and windows over time."""
