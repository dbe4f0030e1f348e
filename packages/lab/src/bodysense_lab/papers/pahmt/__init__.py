"""PAHMT (Liu et al. 2022): networks of arms and hands, training, tables."""
