"""Demonstration performance: a body of hinges, a choreography, and a solver."""
