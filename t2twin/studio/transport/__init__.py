"""Connections, messages and files of clients."""
