"""Sections about a dataset."""
