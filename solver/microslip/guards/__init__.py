"""What holds for all ranks of a run: one end, one run a folder, memory refused before it is taken."""
