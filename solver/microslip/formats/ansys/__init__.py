"""Ansys archives (.cdb), as CDWRITE writes them, input files, as Workbench does (ds.dat), and results (.rst)."""
