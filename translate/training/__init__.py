"""Training: one loop for all translators."""
