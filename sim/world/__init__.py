"""Worlds: recipes that say what is pressed, where, how hard and in which light."""
