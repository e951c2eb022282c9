"""Errors, files, records, images and compiled loops: what all other packages build on."""
