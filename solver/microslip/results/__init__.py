"""The results of a run: frf.csv, results.h5, pictures, fields for ParaView, the energy audit."""
