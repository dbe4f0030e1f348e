"""The laboratory: everything that trains, scores or reproduces; the library never imports it."""
