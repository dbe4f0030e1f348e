"""Scores of the tracker on scripted scenes, for `bodysense evaluate scenes`."""
