"""Training, checkpoints and tables, shared by all methods."""
