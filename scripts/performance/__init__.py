"""The demonstration performance: a body of hinges, a solver, and what it does."""
