"""Several methods at the same points."""
