"""A run's folder: configuration, checkpoints, log and model card."""

from t2twin.translate.library_settings import configure_libraries

configure_libraries()
