"""The reduced model in time: steps, contact in a step, steady state.  NumPy; nothing here knows harmonic balance's kernel."""
