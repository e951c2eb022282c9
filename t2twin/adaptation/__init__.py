"""Adaptation of a translator to one gel camera, from its background frame and presses of a ball."""
