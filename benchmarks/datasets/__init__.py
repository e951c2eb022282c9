"""Content of datasets, and runs that are killed."""
