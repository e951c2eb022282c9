"""Reads and repairs solids from files.

The function `read` of each format returns the mesh in the file's units, and the length of a unit in
mm (1 where the format has none). It raises ValueError with a clause about the file.
"""
