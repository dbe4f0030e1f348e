"""The error that the add-on shows in one line."""


class Fault(Exception):
    """A mistake that the user can correct; its text is one line."""
