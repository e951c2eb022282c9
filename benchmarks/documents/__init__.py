"""The results' figures in README.md and docs/: bound to the results files, written by a command."""
