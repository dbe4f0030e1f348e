"""Motion data: clips, stores, preparation and windows."""
