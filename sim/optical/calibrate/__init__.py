"""The fit of the DIGIT's optics to a user's sensor."""
