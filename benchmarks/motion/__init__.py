"""Sliding contact and sensors in MuJoCo models."""
