"""phi, the translators, their training and their evaluation."""
