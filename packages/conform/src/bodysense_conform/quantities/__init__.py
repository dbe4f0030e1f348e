"""Quantities of a subject that are more than an expression of `checks.toml`, by theme."""
