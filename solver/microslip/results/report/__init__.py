"""One page with everything of a run, for a browser: made from results.h5 alone, no network."""
