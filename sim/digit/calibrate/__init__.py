"""Calibrating the DIGIT's optics to a user's own sensor."""
