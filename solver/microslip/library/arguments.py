"""Arguments of the functions of the library: an open structure, and numbers in their range."""

from __future__ import annotations

import numbers
from math import inf
from typing import Any

import numpy as np

from ..messages.errors import CaseError
from .build import Structure


def refuse_no_structure(structure: Any, where: str) -> None:
    """Raise CaseError unless the argument is a structure that is not closed.  Local; the same on every rank."""
    if not isinstance(structure, Structure):
        kind = type(structure).__name__
        raise CaseError(f"{where}: expected a structure, as microslip.build(microslip.read(PATH)) returns it, found {kind}")
    structure.refuse_closed()


def scalar(value: Any) -> Any:
    """Return the number of an array without axes; anything else as it is."""
    return value.item() if isinstance(value, np.ndarray) and value.ndim == 0 else value


def whole_number(value: Any, least: int, where: str) -> int:
    """Return a whole number of at least ``least``.  Local.  Raises CaseError: anything else."""
    value = scalar(value)
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, numbers.Integral) or value < least:
        raise CaseError(f"{where} = {value!r}: expected a whole number of at least {least}")
    return int(value)


def number_above(value: Any, bound: float, where: str) -> float:
    """Return a finite number above ``bound``.  Local.  Raises CaseError: anything else."""
    value = scalar(value)
    is_number = isinstance(value, numbers.Real) and not isinstance(value, (bool, np.bool_))
    if not is_number or not bound < value < inf or value > np.finfo(float).max:
        raise CaseError(f"{where} = {value!r}: expected a number above {bound:g}")
    return float(value)
