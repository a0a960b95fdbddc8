"""Contact laws: what a pair exchanges over a period or a step of time.  NumPy and one compiled kernel; no MPI, no PETSc."""
