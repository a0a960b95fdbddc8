"""Readers of other programs' model files; each returns a ``FileModel``, and the scene selects from it."""
