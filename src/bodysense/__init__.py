"""bodysense completes a human body, hands included, from partial and occluded tracking, in real time."""

__version__ = "0.1.0"
