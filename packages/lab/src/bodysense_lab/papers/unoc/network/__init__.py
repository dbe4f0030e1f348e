"""The networks of UNOC, their losses and files."""
