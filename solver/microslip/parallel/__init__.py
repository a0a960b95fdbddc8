"""MPI and PETSc: initialisation, agreement between ranks, groups of ranks, ownership, graph partition by METIS."""
