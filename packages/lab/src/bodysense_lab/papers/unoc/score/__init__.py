"""The tables of UNOC."""
