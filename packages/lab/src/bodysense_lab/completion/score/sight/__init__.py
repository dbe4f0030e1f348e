"""Scores of wearers with the sight of a real headset."""
