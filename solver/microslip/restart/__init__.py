"""Checkpoints of a run, continuation from them, and a cache of structures shared by runs."""
