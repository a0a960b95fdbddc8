"""Nonlinear modes: frequency and damping against amplitude, and the forced response that follows from them."""
