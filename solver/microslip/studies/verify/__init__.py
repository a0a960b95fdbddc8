"""Time integration beside harmonic balance: the same model marched to its steady state at some points."""
