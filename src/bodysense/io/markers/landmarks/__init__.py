"""Landmarks of the body that several marker sets share."""
