"""Observations of a person over time, from any device."""
