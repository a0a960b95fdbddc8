"""Ansys archives (.cdb), as CDWRITE writes them."""

from .read import read_cdb

__all__ = ["read_cdb"]
