"""Shapes without end: each drawn from a number, a composition of one to four features."""
