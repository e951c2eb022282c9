"""t2twin: a simulated twin of touch-to-touch translation."""
