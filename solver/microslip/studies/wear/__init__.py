"""Wear of joints over cycles: depth, preload, and the drift of the response."""
