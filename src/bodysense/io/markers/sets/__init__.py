"""Marker sets, one file each (docs/markers.md)."""
