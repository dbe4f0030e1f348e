"""Tables of figures in README, docs and model cards: a module a subject; `scripts/write_figures.py` writes them all."""
