"""What is observed: the world of a source."""
