"""Who watches a run: log, screen, what stops it, what it left out.  Nothing here changes a result."""
