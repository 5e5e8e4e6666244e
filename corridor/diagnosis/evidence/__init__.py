"""How much more likely the data are with groups of candidates: search, and what limits it."""
