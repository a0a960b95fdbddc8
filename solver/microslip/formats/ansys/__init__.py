"""Ansys archives (.cdb), as CDWRITE writes them, input files, as Workbench does (ds.dat), and results (.rst)."""

from .read import is_input, read_cdb, read_input
from .results import read_rst

__all__ = ["is_input", "read_cdb", "read_input", "read_rst"]
