"""Inference with networks of papers: HMD-VAE, UNOC's fingers."""
