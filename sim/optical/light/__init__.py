"""The light on the DIGIT's gel: LEDs, illumination, shadows, rays, coating."""
