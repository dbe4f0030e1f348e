"""Tables of figures in README, docs and model cards, one module for each subject; see `scripts/write_figures.py`."""
