"""Images of the DIGIT, and optics to real frames."""
