"""Two hands (Pavllo et al. 2019): networks of a glove with hidden markers, training, tables."""
