"""Simulated devices: poses in, observations of them by a device out."""
