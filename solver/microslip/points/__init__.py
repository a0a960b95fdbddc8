"""A converged point of a curve: its quantities, the branch of many, their range, which pairs may slip at the next."""
