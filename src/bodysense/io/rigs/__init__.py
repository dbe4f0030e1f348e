"""Rigs: skeletons of other programs, recognised by structure first, by names second, by an explicit table last."""
