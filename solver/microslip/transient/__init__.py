"""Time integration of the reduced model: scheme, contact in a step, steady state.  Independent of harmonic balance's kernel."""
