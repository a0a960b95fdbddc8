"""Several methods at the same points of the same structure: differences, unknowns and times."""
