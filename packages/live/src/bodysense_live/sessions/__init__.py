"""One wearer's session: signals in, displayed bodies and recordings out."""
