"""What the last round amounts to: effects with values, shapes with places, and the verdict."""
