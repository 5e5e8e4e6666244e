"""The verb of certificates."""
