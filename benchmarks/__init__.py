"""Timings against other programs, and how often the diagnosis is right."""
