"""The server: connections, scheduling and workers."""
