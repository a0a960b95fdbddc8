"""Independent reference solutions: NumPy and SciPy only, no code shared with microslip."""
