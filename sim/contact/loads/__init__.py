"""Contacts under prescribed forces and torques."""
