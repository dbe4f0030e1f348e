"""User studies: clips, page, analysis."""
