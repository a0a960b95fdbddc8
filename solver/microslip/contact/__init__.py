"""Contact laws: the forces of a pair over a period or a time step.  NumPy and compiled kernels; no MPI, no PETSc."""
