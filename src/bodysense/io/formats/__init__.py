"""File formats and wire formats, each in a module."""
