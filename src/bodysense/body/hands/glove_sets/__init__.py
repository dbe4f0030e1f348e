"""Marker sets of gloves that come with the package, a file each (`body.glove_set`)."""
