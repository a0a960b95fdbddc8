"""The command `verify`: comparison of harmonic balance with time integration of the same model at some points."""
