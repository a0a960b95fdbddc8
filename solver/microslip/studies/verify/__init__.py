"""Time integration beside harmonic balance."""
