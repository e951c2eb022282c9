"""Measurements of the project: each module is a command that prints and stores its figures."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
"""The repository."""
