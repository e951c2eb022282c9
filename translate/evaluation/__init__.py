"""Evaluation of trained runs on datasets."""

from t2twin.translate.library_settings import configure_libraries

configure_libraries()
