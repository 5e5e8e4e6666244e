"""Verbs of the core, one a file; those of a tool stand in its folder."""
