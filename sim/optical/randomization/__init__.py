"""Domain randomization: samples units of gel cameras."""
