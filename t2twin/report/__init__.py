"""HTML reports of a dataset, and of runs with their evaluation."""
