"""Names of glove markers: assigned, searched and checked."""
