"""The paired dataset: makes, checks and imports it, and reads its files."""
