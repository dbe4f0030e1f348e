"""A live server for benchmarks."""
