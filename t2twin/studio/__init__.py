"""The studio: presses shapes and translates images in a browser."""
