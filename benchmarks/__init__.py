"""Measurements of the project, each a command that prints and keeps its figures."""
