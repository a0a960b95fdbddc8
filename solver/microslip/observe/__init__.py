"""Observers of a run: log, screen, stops, list of what was not computed.  None of them changes a result."""
