"""Numbers of a text."""

from __future__ import annotations

import warnings

import numpy as np


def numbers_of(text: bytes) -> np.ndarray | None:
    """Return the numbers of a text with blanks between them, (n,); None where anything else is in it.  Local."""
    if not text.strip():
        return np.empty(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # older NumPy only warns where the text stops being numbers
        try:
            return np.fromstring(text, sep=" ")  # type: ignore[arg-type]
        except (ValueError, DeprecationWarning):
            return None
