"""Whole recordings: tracked both ways, joined, filled and saved."""
