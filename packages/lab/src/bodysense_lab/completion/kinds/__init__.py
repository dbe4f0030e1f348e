"""Sets of sensors of any kind."""
