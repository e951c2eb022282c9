"""Images of the DIGIT, and calibration to real frames."""
