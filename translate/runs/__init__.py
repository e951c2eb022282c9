"""A run's folder: its config, its checkpoints, its model card."""
