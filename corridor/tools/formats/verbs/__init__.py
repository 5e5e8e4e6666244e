"""Verbs of formats, one a file."""
