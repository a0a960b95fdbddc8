"""What a run leaves behind: frf.csv, results.h5, pictures, fields for ParaView, the energy audit."""
