"""Pairs and images for training and prediction."""
