"""Video device: pictures in, points of a person out."""
