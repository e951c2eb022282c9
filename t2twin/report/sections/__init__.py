"""Sections of the report of runs."""
