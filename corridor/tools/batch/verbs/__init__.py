"""Verbs of batch, one a file."""
