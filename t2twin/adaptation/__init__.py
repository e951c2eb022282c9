"""Adaptation of a translator to one DIGIT, from its background frame and presses of a ball."""
