"""Live: frames as they arrive, from a camera, a video file or a folder, to counts."""
