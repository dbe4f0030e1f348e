"""The packaged networks, one self-describing file each."""
