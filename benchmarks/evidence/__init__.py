"""How every measurement is declared, run, kept with its provenance, and found to be stale."""
