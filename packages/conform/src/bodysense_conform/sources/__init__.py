"""What gives subjects: files and streams, each read as it is, faults included."""
