"""Rotations, rigid motions and products of vectors, without a body."""
