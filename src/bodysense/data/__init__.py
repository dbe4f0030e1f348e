"""Motion files to clips in one canonical form, and from clips to what training reads."""
