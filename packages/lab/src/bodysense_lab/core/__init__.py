"""Training, checkpoints, tables and charts, shared by all methods."""
