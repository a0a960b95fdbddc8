"""Guards of a run on all ranks: common end, one run per folder, memory checks before allocation."""
