"""Noise of what is measured: of the pictures, and of the antenna positions."""
