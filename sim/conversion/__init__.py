"""Conversion of datasets to the formats of other projects."""
