"""Training of translators and calibration of their uncertainty."""
