"""Agreement between ranks, start of PETSc, log of rank 0.  Imported by every stage, imports none."""
