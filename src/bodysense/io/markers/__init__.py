"""Marker files of any program, recognised as gloves or as a body."""
