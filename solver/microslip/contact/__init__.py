"""Contact laws: what a pair exchanges over a period or a step of time.  NumPy and compiled kernels; no MPI, no PETSc."""
