"""A referee for body trackers: checks whether a tracker's output is a moving human body."""
