"""Measurements of the project, by subject: most modules are commands that print their figures."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
"""The repository."""
