"""Pairs and images as the networks take them."""
