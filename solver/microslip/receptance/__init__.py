"""The receptance of pairs, loads and outputs: modes, damping and static residuals, applied harmonic by harmonic."""
