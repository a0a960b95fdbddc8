"""The reduced model for other programs."""
