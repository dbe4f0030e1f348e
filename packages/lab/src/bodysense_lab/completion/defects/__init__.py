"""Defects made up in true motion, and how well they are found and repaired."""
