"""Wear of joints over cycles: depth, preload, and what drifts with them."""
