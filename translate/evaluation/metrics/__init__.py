"""Metrics of predictions, baselines and error floors."""
