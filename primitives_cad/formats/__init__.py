"""Triangles from users' files, one format a module.

Each reads a file into one mesh and says how many mm one of the file's units is. What cannot be
read raises ValueError with a clause that says why; t2twin.primitives_cad.files makes it a sentence.
"""
