"""The fit of a gel camera's optics to a user's unit."""
