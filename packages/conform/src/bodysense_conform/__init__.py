"""A referee for body trackers: is what a tracker gives out a body that moves?"""
