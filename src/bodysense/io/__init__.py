"""Formats of files, and the rigs that they come in."""
