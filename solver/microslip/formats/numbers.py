"""Conversion of a text to numbers."""

import warnings

import numpy as np


def numbers_of(text: bytes) -> np.ndarray | None:
    """Return the blank-separated numbers of a text, (n,); None if the text contains anything else.  Local."""
    if not text.strip():
        return np.empty(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # older NumPy only warns of text that is not a number
        try:
            return np.fromstring(text, sep=" ")  # type: ignore[arg-type]
        except (ValueError, DeprecationWarning):
            return None
