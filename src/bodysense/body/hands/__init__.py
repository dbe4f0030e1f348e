"""A hand, its shape, and the glove that it wears."""
