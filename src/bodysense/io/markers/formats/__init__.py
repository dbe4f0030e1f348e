"""File formats of marker systems."""
