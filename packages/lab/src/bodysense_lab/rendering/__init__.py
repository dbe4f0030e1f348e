"""Rendered videos of people, with their truth."""
