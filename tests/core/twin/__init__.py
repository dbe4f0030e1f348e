"""The slow twin of the core's features, networks and expected errors: plain NumPy, written to be read.

A module has the name of the core's file. clock → tracked → features → network → fingers → errors
"""
