"""The verb of the check."""
