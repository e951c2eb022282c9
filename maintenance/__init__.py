"""Commands that write the files bundled with the package, from a clone."""
