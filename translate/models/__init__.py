"""Translators: networks with their losses, optimizers and predictions."""

from t2twin.translate.library_settings import configure_libraries

configure_libraries()
