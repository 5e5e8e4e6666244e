"""Verbs of change, one a file."""
