"""FBX: a reader of skeletons and animations by ufbx, and a writer of both."""
