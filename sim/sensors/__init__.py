"""Sensors: their files, and pairs of them."""
