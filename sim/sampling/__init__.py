"""Sampling: recipes of shapes, positions, forces and light, and the presses they define."""
