"""Inverse kinematics of the papers: bodies that meet targets within the limits of their joints."""
