"""Who may connect, and certificates."""
