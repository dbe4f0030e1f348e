"""Published data sets: layouts of their folders, and splits by person."""
