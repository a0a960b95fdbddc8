"""Two results compared as curves, with what was asked for, and a verdict."""
