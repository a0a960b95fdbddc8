"""Nastran bulk data (.bdf, .nas, .dat)."""

from .read import read_bdf

__all__ = ["read_bdf"]
