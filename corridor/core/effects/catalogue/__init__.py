"""One effect, one file; found by looking in this folder."""
