"""Taxel arrays: layouts, counts under a pressure, and tactile images."""
