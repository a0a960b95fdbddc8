"""Services of one machine: processes, files, signals, limits; no MPI."""
