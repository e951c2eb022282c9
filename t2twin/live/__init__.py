"""Live translation of the frames of a camera, a video file or a folder."""
