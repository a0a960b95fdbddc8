"""Anderson acceleration of a fixed-point iteration (docs/theory.md, section 11)."""

import numpy as np

from .balance import HarmonicBalance


class Anderson:
    """Anderson acceleration of a fixed-point iteration x = g(x), with the history of all steps (Walker and Ni 2011)."""

    def __init__(self, equation: HarmonicBalance):
        self.equation = equation
        self.values: list[np.ndarray] = []  # g(x) of all steps, this rank's rows
        self.misses: list[np.ndarray] = []  # g(x) - x

    def next(self, x: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the next x, and the last residual |g(x) - x| / |g(x)|.  Collective: one sum and one broadcast.

        The next x is the weighted mean of all values g(x); the weights minimise the residual.
        """
        self.values.append(value)
        self.misses.append(value - x)
        miss = self.misses[-1].ravel()
        rows = np.stack([*(other.ravel() - miss for other in self.misses[:-1]), miss, value.ravel()])
        products, n = self.equation.agreed_sum(rows @ rows.T), len(rows) - 2
        weights = least(products[:n, :n], -products[:n, n])
        mean = value + sum(weight * (other - value) for weight, other in zip(weights, self.values))
        size = products[n + 1, n + 1]
        return mean, float(np.sqrt(products[n, n] / size)) if size > 0.0 else 0.0


def least(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the minimum-norm least-squares solution of A x = b, for A (n, n) symmetric, n >= 0.  Local."""
    if len(b) < 2:
        return np.divide(b, A.diagonal(), out=np.zeros_like(b), where=A.diagonal() > 0.0)
    return np.linalg.lstsq(A, b, rcond=1e-12)[0]
