"""Trained runs as predictors: loading, batches of files, ONNX."""

from t2twin.translate.library_settings import configure_libraries

configure_libraries()
