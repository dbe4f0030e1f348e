"""Protocols of other programs, a file or a folder each."""
