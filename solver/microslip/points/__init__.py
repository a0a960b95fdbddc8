"""A converged point and its quantities, the branch of points, its range, and the pairs that may slip at the next point."""
