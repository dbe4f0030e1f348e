"""Bodies for programs that drive humanoid robots, by ZeroMQ."""
