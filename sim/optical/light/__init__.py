"""The light on the gel: LEDs, illumination, shadows, rays, coating."""
