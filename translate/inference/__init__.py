"""Trained runs as predictors: loading, batches of files, ONNX."""
