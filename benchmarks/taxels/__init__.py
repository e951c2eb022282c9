"""Counts of the CySkin."""
