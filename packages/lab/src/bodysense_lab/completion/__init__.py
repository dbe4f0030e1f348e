"""Architecture, training and evaluation of the completion network."""
