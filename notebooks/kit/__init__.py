"""What only the chapters need: published figures, lessons, special flights."""
