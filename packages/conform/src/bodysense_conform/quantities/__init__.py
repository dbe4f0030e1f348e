"""Quantities: figures of a subject over time, by theme, as `checks.toml` names them."""
