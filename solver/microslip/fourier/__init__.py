"""Harmonics of a period: sets of them, their coefficients and samples.  NumPy only."""
