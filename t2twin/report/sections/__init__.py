"""Sections about runs and their evaluation."""
