"""The DIGIT's camera: its pinhole, its response, its noise."""
