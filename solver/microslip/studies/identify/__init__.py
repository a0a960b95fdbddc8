"""Identification: numbers of a scene that explain a measurement."""
