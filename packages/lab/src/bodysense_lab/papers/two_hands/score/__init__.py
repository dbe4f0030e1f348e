"""The tables of two hands."""
