"""The linear system at a state, with a column for each candidate, and what is left of those."""
