"""Evaluation of trained runs on datasets."""
