"""Sections of the report of a dataset."""
