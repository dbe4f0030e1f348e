"""Files and streams of any kind, recognised, opened, read and written."""
