"""Trained runs in use: prediction, batches of files, ONNX."""
