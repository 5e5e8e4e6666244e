"""Verbs of readout, one a file."""
