"""Access control and certificates."""
