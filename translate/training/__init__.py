"""Training of translators and calibration of their uncertainty."""

from t2twin.translate.library_settings import configure_libraries

configure_libraries()
