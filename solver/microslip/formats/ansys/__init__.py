"""Ansys archives (.cdb), as CDWRITE writes them, and input files, as Workbench does (ds.dat)."""

from .read import is_input, read_cdb, read_input

__all__ = ["is_input", "read_cdb", "read_input"]
