"""Code that flatc writes from `schema/` (scripts/make_protocol_types.py); not edited."""
