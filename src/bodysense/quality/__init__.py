"""How well a motion is estimated, and whether it moves like a person."""
