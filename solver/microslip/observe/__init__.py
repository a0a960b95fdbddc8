"""Who watches a run: log, screen, reports to the result files.  Nothing here changes a result."""
