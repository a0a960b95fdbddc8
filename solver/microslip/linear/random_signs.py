"""Random signs of rows, independent of the rank that owns a row."""

import numpy as np

MOST = 64  # columns: bits of a random word
_WORDS = 4  # words of a step of the counter


def random_signs(first: int, n: int, n_columns: int, key: int) -> np.ndarray:
    """Return -1 and 1 at random in rows ``first`` to ``first + n``, (n, n_columns), by a ``key`` of the sequence.  Local."""
    generator = np.random.Philox(key=key)
    generator.advance(first // _WORDS)
    words = generator.random_raw(first % _WORDS + n)[first % _WORDS :]
    bits = (words[:, None] >> np.arange(n_columns, dtype=np.uint64)) & np.uint64(1)
    return 1.0 - 2.0 * bits.astype(float)
