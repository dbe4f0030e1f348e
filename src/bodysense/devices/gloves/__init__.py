"""Gloves with markers, some of them hidden: posed hands at run time (two-hands; NumPy and ONNX Runtime)."""
