"""The DIGIT's camera: projection, response, noise."""
