"""What the program needs of one machine: processes, files, signals, limits; no MPI."""
