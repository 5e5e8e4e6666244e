"""Verbs of data, one a file."""
