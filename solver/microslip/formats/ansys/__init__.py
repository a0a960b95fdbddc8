"""Readers of Ansys archives by CDWRITE (.cdb), input files of Workbench (ds.dat) and results (.rst)."""
