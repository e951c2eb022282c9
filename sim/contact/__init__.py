"""Soft contact: a rigid shape pressed into a sensor's elastomer with a commanded force."""
