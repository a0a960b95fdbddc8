"""Nonlinear modes: frequency and damping against amplitude, and the forced response synthesised from them."""
