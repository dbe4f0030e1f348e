"""Sequences that the networks of UNOC learn from."""
