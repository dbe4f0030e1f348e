"""Synthesised motion of hands."""
