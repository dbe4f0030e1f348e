"""Scores and tables of completion."""
