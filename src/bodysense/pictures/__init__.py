"""Motion to pictures: sheets, animations, drawn over a video."""
