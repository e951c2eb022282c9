"""Content of datasets and of random presses, and runs that are killed."""
