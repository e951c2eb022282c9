"""The translators: networks with their training step and their prediction."""
