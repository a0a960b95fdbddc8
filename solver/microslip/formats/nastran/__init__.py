"""Nastran bulk data (.bdf, .nas, .dat), and the geometry of its output (.op2)."""

from .op2 import read_op2_model
from .read import read_bdf

__all__ = ["read_bdf", "read_op2_model"]
