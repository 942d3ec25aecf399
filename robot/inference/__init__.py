"""From a camera frame through an ONNX network to a choice of action."""
