"""Parametric bootstrap: simulated replicates of a measured block, and the block beside them."""
