"""A run's folder: configuration, checkpoints, log and model card."""
