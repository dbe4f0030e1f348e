"""Gloves with markers, some of them hidden → hands: the run time of two-hands (NumPy and ONNX Runtime)."""
