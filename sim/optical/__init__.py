"""Gel cameras: light on the deflected gel, and the camera's image of it."""
