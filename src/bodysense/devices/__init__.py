"""Devices: solvers that turn signals into observed points of a body, which the tracker completes."""
