"""The sensors of a twin unless others are given: those of Grella et al. 2023."""

ROLES = ("source", "target")  # The roles of the two sensors of a twin
SOURCE, TARGET = "digit", "cyskin-20"

ALIASES = {"cyskin": "cyskin-20"}  # Other names of bundled sensors
