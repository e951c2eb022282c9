"""Domain randomization: samples DIGIT units."""
