"""The slow twin of the core's step: plain NumPy, written to be read. A module has the name of the core's file.

clock → tracked → mounts → proportions → features → network → trunk, legs, feet, arms → fingers → errors
"""
