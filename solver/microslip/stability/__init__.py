"""Stability of periodic motions: the map of one cycle with the memory of the sliders, and its multipliers."""
