"""Published data sets: what their folders tell, and splits by person."""
