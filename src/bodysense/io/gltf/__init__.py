"""glTF 2.0 and what VRM adds to it: motion read, motion written."""
