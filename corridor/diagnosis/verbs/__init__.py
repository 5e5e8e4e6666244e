"""The verb of the diagnosis."""
