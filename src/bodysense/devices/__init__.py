"""Devices with a solver inside: they turn signals into observed points of a body, for the tracker to complete."""
