"""UNOC (Parger et al. 2021): networks, training, tables."""
