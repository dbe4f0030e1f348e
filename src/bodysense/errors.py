"""The one family of errors that bodysense raises on purpose."""


class BodysenseError(Exception):
    """Something the user gave cannot be used. The text names the value, what would be valid, and the fix."""
