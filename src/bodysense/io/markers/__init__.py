"""Marker files: read whoever wrote them, and recognised as gloves or as a body."""
