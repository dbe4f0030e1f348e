"""The completion networks and their files."""
