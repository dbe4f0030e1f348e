"""The demo's own performance."""
