"""Connections to clients: origins, messages, uploads and the log."""
