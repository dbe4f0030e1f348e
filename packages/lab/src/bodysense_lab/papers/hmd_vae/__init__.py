"""HMD-VAE (Dittadi et al. 2021): networks, training, tables."""
