"""Counts of a taxel array."""
