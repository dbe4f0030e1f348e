"""Fitting networks, and writing them as ONNX."""
