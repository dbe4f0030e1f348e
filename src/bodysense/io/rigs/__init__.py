"""Rigs: skeletons of other programs, recognised by an explicit table, else by names."""
