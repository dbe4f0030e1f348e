"""Templates of measured tables, and measurements of the machine; see `scripts/write_figures.py`."""
