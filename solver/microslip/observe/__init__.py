"""Observers of a run: log, screen, stops, list of omitted computations.  None of them changes a result."""
