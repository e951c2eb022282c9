"""The camera: projection, response, noise."""
