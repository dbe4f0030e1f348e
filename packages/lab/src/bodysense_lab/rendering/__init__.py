"""Rendered people on video, with their truth."""
