"""Shared by all networks: streaming, attention, ONNX graphs, checkpoints."""
