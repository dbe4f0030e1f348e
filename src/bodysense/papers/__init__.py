"""Networks of papers, as commands of the library use them: HMD-VAE, UNOC's fingers."""
