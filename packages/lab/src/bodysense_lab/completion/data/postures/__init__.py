"""Changes of recorded motion: postures that are rare in recordings, straight legs and an upright stance."""
