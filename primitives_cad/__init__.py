"""Parametric tactile primitives and hand tools, and any solid a user brings: named shapes
with the surface that faces a sensor."""
