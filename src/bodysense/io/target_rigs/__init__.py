"""Rigs that a motion is written on: those of other programs by name, and that of the file it came from."""
