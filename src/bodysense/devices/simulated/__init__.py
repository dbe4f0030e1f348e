"""Poses become Observations: what a device would see of them."""
