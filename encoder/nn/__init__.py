"""What the networks share: streaming, attention, ONNX graphs, checkpoints."""
