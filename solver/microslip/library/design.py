"""Samples of numbers: grids, one number at a time, scatter by Sobol points or Latin hypercubes; and their Sobol indices."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import lognorm, norm, qmc

from ..messages.errors import CaseError

DISTRIBUTIONS = ("lognormal", "normal", "uniform")
KINDS = ("sobol", "latin", "indices")
MOST = 100_000  # samples of a design


@dataclass(frozen=True, eq=False)
class Design:
    """The samples of some numbers."""

    keys: tuple[str, ...]
    values: np.ndarray  # (n, n_keys)
    shape: tuple[int, ...]  # of a grid the lengths of its axes; else (n,)
    kind: str = "samples"  # grid, one by one, sobol, latin, indices, samples
    coordinates: tuple[np.ndarray, ...] = ()  # of a grid the values of each axis; else the column of each number

    @classmethod
    def of_columns(cls, keys: Sequence[str], values: np.ndarray, kind: str = "samples") -> Design:
        """Return given samples.  Local."""
        return cls(tuple(keys), values, (len(values),), kind, tuple(values.T))

    @classmethod
    def paired(cls, values: Mapping[str, ArrayLike]) -> Design:
        """Return the samples of numbers at the same place of each list.  Local.

        Raises
        ------
        CaseError : lists of different length, or none
        """
        columns = _columns(values)
        lengths = {key: len(column) for key, column in columns.items()}
        if len(set(lengths.values())) > 1:
            text = ", ".join(f"{key} has {n}" for key, n in lengths.items())
            raise CaseError(f"sweep: paired lists have one length: {text}")
        return cls.of_columns(tuple(columns), np.column_stack(list(columns.values())))

    @property
    def is_grid(self) -> bool:
        """Whether the samples form a grid."""
        return self.kind == "grid"

    @property
    def is_random(self) -> bool:
        """Whether the samples are of a distribution, which percentiles describe."""
        return self.kind not in ("grid", "one by one")

    @property
    def axes(self) -> tuple[str, ...]:
        """The names of the axes: of a grid the keys."""
        return self.keys if self.is_grid else ("sample",)

    @cached_property
    def spread(self) -> np.ndarray:
        """The standard deviation of each number, (n_keys,)."""
        return self.values.std(axis=0) if len(self.values) else np.ones(len(self.keys))

    def __len__(self) -> int:
        return len(self.values)


def grid(values: Mapping[str, ArrayLike]) -> Design:
    """Return all combinations, the last key varying first.  Local.

    Raises
    ------
    CaseError : no values, a value stated twice, or more combinations than ``MOST``
    """
    columns = _distinct(_columns(values))
    shape = tuple(len(column) for column in columns.values())
    if np.prod([float(n) for n in shape]) > MOST:
        raise CaseError(f"sweep: {' x '.join(map(str, shape))} combinations are more than {MOST}; take fewer values")
    places = np.meshgrid(*columns.values(), indexing="ij")
    return Design(tuple(columns), np.column_stack([place.ravel() for place in places]), shape, "grid", tuple(columns.values()))


def one_by_one(values: Mapping[str, ArrayLike], nominal: Mapping[str, float]) -> Design:
    """Return the samples of which one number alone differs from the scene, key after key.  Local.

    Raises
    ------
    CaseError : no values, a value stated twice, or the scene states no number for a key
    """
    columns = _distinct(_columns(values))
    for key in columns:
        if not np.isfinite(nominal[key]):
            raise CaseError(f"sweep: --one-by-one: the scene states no {key}, at which it stays while others vary; state it")
    rows = []
    for key, column in columns.items():
        rows += [[value if other == key else nominal[other] for other in columns] for value in column]
    return Design.of_columns(tuple(columns), np.array(rows), "one by one")


@dataclass(frozen=True)
class Scatter:
    """How a number scatters about its mean."""

    mean: float
    percent: float  # standard deviation; of a uniform distribution half of its range
    distribution: str = "lognormal"

    def at(self, share: np.ndarray) -> np.ndarray:
        """Return the quantiles of shares (n,).  Local."""
        relative = self.percent / 100.0
        if self.distribution == "uniform":
            return self.mean * (1.0 + relative * (2.0 * share - 1.0))
        if self.distribution == "normal":
            return norm.ppf(share, self.mean, abs(self.mean) * relative)
        s = np.sqrt(np.log1p(relative**2))
        return np.sign(self.mean) * lognorm.ppf(share, s, scale=abs(self.mean) * np.exp(-0.5 * s * s))


def scattered(scatter: Mapping[str, Scatter], n: int, kind: str = "sobol", seed: int = 0) -> Design:
    """Return samples of scattered numbers: Sobol points, a Latin hypercube, or those of Sobol indices.  Local.

    ``indices`` are n (d + 2) samples: of two sets A and B, and for each number A with the column of B (Saltelli 2010), those of
    each base sample one after another: A, A with each column of B, B, as SALib has them.

    Raises
    ------
    CaseError : more than ``MOST``
    """
    d = len(scatter)
    if n * (d + 2 if kind == "indices" else 1) > MOST:
        raise CaseError(f"sweep: --samples {n} make more than {MOST} samples; take fewer")
    share = _shares(2 * d if kind == "indices" else d, n, kind, seed)
    if kind == "indices":
        A, B = share[:, :d], share[:, d:]
        mixed = [np.where(np.arange(d) == j, B, A) for j in range(d)]
        share = np.stack([A, *mixed, B], axis=1).reshape(-1, d)
    values = np.column_stack([each.at(share[:, j]) for j, each in enumerate(scatter.values())])
    return Design.of_columns(tuple(scatter), values, kind)


def _shares(d: int, n: int, kind: str, seed: int) -> np.ndarray:
    """Return points of the unit cube, (n, d), none on its surface."""
    sampler = qmc.LatinHypercube(d, seed=seed) if kind == "latin" else qmc.Sobol(d, scramble=True, seed=seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # n that is no power of two: documented in the guide
        points = sampler.random(n)
    return np.clip(points, 1e-12, 1.0 - 1e-12)


def sobol_indices(y: np.ndarray, d: int) -> tuple[np.ndarray, np.ndarray]:
    """Return main and total Sobol indices, (d,) both, of the samples of a design ``indices``, y (n (d + 2),).  Local.

    Estimators of Saltelli (2010) and Jansen (1999), docs/theory.md, eq. (7.15).  A base sample of which one of its d + 2 has
    no value is left out; NaN where fewer than two are left or nothing varies.
    """
    A, *mixed, B = y.reshape(-1, d + 2).T
    is_complete = np.isfinite(y.reshape(-1, d + 2)).all(axis=1)
    variance = np.var(np.concatenate([A[is_complete], B[is_complete]])) if is_complete.sum() > 1 else 0.0
    if not variance > 0.0:
        return np.full(d, np.nan), np.full(d, np.nan)
    centre = np.mean(np.concatenate([A[is_complete], B[is_complete]]))
    main = [np.mean((B[is_complete] - centre) * (AB[is_complete] - A[is_complete])) / variance for AB in mixed]
    all_of_it = [0.5 * np.mean((A[is_complete] - AB[is_complete]) ** 2) / variance for AB in mixed]
    return np.array(main), np.array(all_of_it)


def sobol_intervals(y: np.ndarray, d: int, n_draws: int = 200) -> tuple[np.ndarray, np.ndarray]:
    """Return half of the ranges of 95 % of main and total indices, (d,) both, by drawing the base samples again.  Local.

    ``y`` as in :func:`sobol_indices`.  With few samples a main index can exceed the total one by as much.
    """
    of_base, random = y.reshape(-1, d + 2), np.random.default_rng(0)
    n = len(of_base)
    drawn = [sobol_indices(of_base[random.integers(n, size=n)].ravel(), d) for _ in range(n_draws)]
    usable = [both for both in drawn if np.isfinite(both).all()]
    if len(usable) < 2:
        return np.full(d, np.nan), np.full(d, np.nan)
    main, total = 1.96 * np.std(usable, axis=0)
    return main, total


def _columns(values: Mapping[str, ArrayLike]) -> dict[str, np.ndarray]:
    """Return the values of each key as a vector.

    Raises
    ------
    CaseError : none, or values that are no numbers
    """
    columns = {}
    if not hasattr(values, "items"):  # a mapping, or a table of pandas
        raise CaseError(f"sweep: values = {values!r}: expected a mapping of keys to lists, as {{'level': [5.0, 10.0]}}")
    for key, listed in values.items():
        try:
            columns[key] = np.atleast_1d(np.asarray(listed, dtype=float))
        except (TypeError, ValueError):
            raise CaseError(f"sweep: {key}: expected numbers, found {listed!r}") from None
        if columns[key].ndim != 1 or len(columns[key]) == 0 or not np.isfinite(columns[key]).all():
            raise CaseError(f"sweep: {key}: expected a list of finite numbers, at least one")
    if not columns:
        raise CaseError("sweep: nothing varies; expected a key with its values, as joints.dovetail.friction with 0.1, 0.2, 0.3")
    return columns


def _distinct(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the values of each key; CaseError if one comes twice."""
    for key, column in columns.items():
        different, counts = np.unique(column, return_counts=True)
        if counts.max() > 1:
            raise CaseError(
                f"sweep: {key}: the value {different[counts.argmax()]:g} is stated {counts.max()} times; state it once"
            )
    return columns
