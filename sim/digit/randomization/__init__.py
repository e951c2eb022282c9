"""Domain randomization: sampled DIGIT units."""
