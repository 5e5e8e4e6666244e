"""Tools beside the core: each one folder with its verb, its function and its page."""
