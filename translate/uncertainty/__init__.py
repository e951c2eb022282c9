"""Predicted uncertainty: estimates, their calibration, out-of-distribution detection."""
