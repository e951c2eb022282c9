"""Measurements of the project, each a command that prints and keeps its figures."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
"""The repository."""
