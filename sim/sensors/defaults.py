"""The sensors of a twin unless others are given: those of Grella et al. 2023."""

SOURCE, TARGET = "digit", "cyskin-20"

ALIASES = {"cyskin": "cyskin-20"}
"""Other names of bundled sensors."""
