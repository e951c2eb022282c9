"""Predictions with uncertainty, its calibration, and out-of-distribution detection."""
