"""The live server: protocol, sessions, avatar protocols (docs/serve.md)."""
