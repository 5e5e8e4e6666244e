"""Verbs of thermal, one a file."""
