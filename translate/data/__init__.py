"""Pairs and images for training and prediction."""

from t2twin.translate.library_settings import configure_libraries

configure_libraries()
