"""Video as a device: pictures in, points of a person out."""
