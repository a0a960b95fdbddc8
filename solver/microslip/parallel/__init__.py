"""MPI and PETSc: their start, agreement between ranks, groups of ranks, who owns what, parts of a graph by METIS."""
