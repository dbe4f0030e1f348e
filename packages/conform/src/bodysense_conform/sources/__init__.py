"""Sources of subjects: files and streams, read unchanged, faults included."""
