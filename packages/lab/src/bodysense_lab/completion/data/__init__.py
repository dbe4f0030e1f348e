"""Sequences that the completion networks learn from."""
