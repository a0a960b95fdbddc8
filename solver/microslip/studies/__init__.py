"""Stories told with the library beside a run: check, new, compare, verify, trade, export, diff, batches."""
