"""Predictions with uncertainty, its calibration, and out-of-distribution detection."""

from t2twin.translate.library_settings import configure_libraries

configure_libraries()
