"""Methods that complete a body at run time, with NumPy and ONNX Runtime only."""
