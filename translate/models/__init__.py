"""Translators: networks with their losses, optimizers and predictions."""
