"""Durations, alone and against other programs or commits."""
