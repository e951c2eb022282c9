"""Reads and repairs the mesh files of users."""
