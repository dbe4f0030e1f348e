"""The packaged networks, one self-describing .onnx file each."""
