"""Completion at run time: the network, the clock, proportions; no I/O and no PyTorch."""
