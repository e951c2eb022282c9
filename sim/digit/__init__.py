"""The DIGIT: light on the deflected gel, and the picture its camera takes of it."""
