"""Simulated sensors attached to a MuJoCo model."""
