"""The paired dataset: its protocol, its making, its files."""
