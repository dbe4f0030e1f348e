"""Signals of devices, and recordings of them, to observations."""
