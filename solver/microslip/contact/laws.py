"""The contact laws by their names in a scene, and the combined law of pairs with several laws."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import iwan, rough
from .bundle import BundleLaw
from .combined import as_one
from .elastic_coulomb import ElasticCoulomb
from .keys import ELASTIC_COULOMB, IWAN, ROUGH
from .law import Law
from .started import started_at

Columns = Mapping[str, np.ndarray]  # of pairs, (n,) each: columns of ContactPairs and further columns of their laws
Keys = Mapping[str, Any]  # of a joint, numbers or None


@dataclass(frozen=True, kw_only=True)
class Kind:
    """Properties of a law that other rooms look up by its name."""

    of_columns: Callable[[Columns], Law]
    law_columns: Callable[[Keys], Mapping[str, float]]  # columns not in ContactPairs, the same for all pairs of a joint
    on_area: Callable[[Keys, np.ndarray], Mapping[str, np.ndarray]]  # columns of a joint of surfaces, from areas of its pairs
    per_point: tuple[str, ...]  # parameters that may differ between contact points of surfaces
    limit: Callable[[Columns, np.ndarray], np.ndarray]  # columns, normal forces N: friction limit [N]
    limits: tuple[str, ...] = ()  # parameters of a joint that do not change its springs
    about_rest: Callable[[Columns, np.ndarray, np.ndarray], Mapping[str, np.ndarray | None]] | None = None  # columns, du, memory
    initial_guess: Callable[[Columns, np.ndarray, np.ndarray], np.ndarray] | None = None  # columns, du before, du of the guess
    above_0: tuple[str, ...] = ()  # columns of a file of pairs that must be positive
    exported: str = ""  # description of its elements and its normal force in an exported model
    is_spring: bool = False  # linear until it slips or opens, from any state: N0 - k_n du_z and k_t (du_t - w)


def _elastic_coulomb(columns: Columns) -> ElasticCoulomb:
    k_t, T0 = columns["k_t"], columns["T0"]
    by_y = {name: columns[name] for name in ("k_ty", "mu_y") if name in columns}
    by_y = {name: np.where(np.isnan(y), columns[of_x], y) for (name, y), of_x in zip(by_y.items(), ("k_t", "mu"))}
    k_xy = np.stack([k_t, by_y.get("k_ty", k_t)], axis=1)
    w0 = np.divide(-T0, k_xy, out=np.zeros_like(T0), where=k_xy > 0.0)
    mu, N0, k_n, separate, open_at_rest = (columns[name] for name in ("mu", "N0", "k_n", "separate", "open_at_rest"))
    return ElasticCoulomb(mu, N0, k_t, k_n, separate, w0, open_at_rest=open_at_rest, k_ty=by_y.get("k_ty"), mu_y=by_y.get("mu_y"))


def _about_rest(columns: Columns, du: np.ndarray, memory: np.ndarray) -> dict[str, np.ndarray | None]:
    """Return the columns of elastic-Coulomb pairs that change about the final state of a march (T0 has the sliders).  Local."""
    N0 = columns["N0"] - columns["k_n"] * du[:, 2]
    return {"N0": N0, "open_at_rest": N0 <= 0.0}


def _coulomb_limit(columns: Columns, N: np.ndarray) -> np.ndarray:
    return columns["mu"] * N


def _by_direction(keys: Keys, area: np.ndarray) -> dict[str, np.ndarray]:
    """Return the columns along y of pairs of surfaces, where a joint states separate values for x and y."""
    stiffness, friction = keys.get("tangential_stiffness_y"), keys.get("friction_y")
    columns = {} if stiffness is None else {"k_ty": stiffness * area}
    return columns if friction is None else {**columns, "mu_y": np.full_like(area, friction)}


LAWS: dict[str, Kind] = {  # their keys: keys.py
    ELASTIC_COULOMB: Kind(
        of_columns=_elastic_coulomb,
        law_columns=lambda keys: {},
        on_area=_by_direction,
        per_point=("friction", "tangential_stiffness", "normal_stiffness", "preload", "gap"),
        limit=_coulomb_limit,
        limits=("friction", "preload"),
        about_rest=_about_rest,
        is_spring=True,
    ),
    ROUGH: Kind(
        of_columns=rough.of_columns,
        law_columns=rough.law_columns,
        on_area=rough.on_area,
        per_point=("friction", "preload"),
        limit=_coulomb_limit,
        limits=("friction",),
        about_rest=rough.about_rest,
        initial_guess=rough.initial_guess,
        above_0=("n0", "kt", "kn"),
        exported=rough.EXPORTED,
    ),
    IWAN: Kind(
        of_columns=iwan.of_columns,
        law_columns=iwan.law_columns,
        on_area=iwan.on_area,
        per_point=("tangential_stiffness", "normal_stiffness"),
        limit=iwan.limit,
        about_rest=iwan.about_rest,
        above_0=("mu", "n0", "kt"),
        exported=iwan.EXPORTED,
    ),
}


def law_of(names: Sequence[str] | np.ndarray, columns: Columns) -> Law:
    """Return the law of pairs from the law name of each pair.  Local.

    ``columns`` have a value for every pair, NaN where the law of a pair does not have the column.
    """
    law = as_one([(pairs, LAWS[law].of_columns(part)) for pairs, law, part in _parts(names, columns)])
    return started_at(law, columns.get("start"))


def about_rest(names: Sequence[str] | np.ndarray, columns: Columns, du: np.ndarray, memory: np.ndarray) -> dict[str, np.ndarray]:
    """Return the columns of pairs that change about the final state of a march.  Local.

    The final state is ``du`` (n, 3) and the internal variables ``memory`` (n, n_memory).

    Raises
    ------
    ValueError : a pair is open at rest and its law needs pressure at rest
    """
    changed: dict[str, np.ndarray] = {}
    for pairs, law, part in _parts(names, columns):
        about = LAWS[law].about_rest
        for name, values in (about(part, du[pairs], memory[pairs]) if about is not None else {}).items():
            assert values is not None, "a state that a march came to"
            if name == "w0":
                values = np.pad(values, ((0, 0), (0, memory.shape[1] // 2 - values.shape[1]), (0, 0)))
            merged = columns[name] if name != "w0" else np.zeros((len(du), *values.shape[1:]))
            changed.setdefault(name, merged.copy())[pairs] = values
    return changed


def friction_limit(names: Sequence[str] | np.ndarray, columns: Columns, N: np.ndarray) -> np.ndarray:
    """Return the friction limit of pairs under normal forces ``N`` (n,) [N], (n,) [N].  Local."""
    limits = np.zeros(len(N))
    for pairs, law, part in _parts(names, columns):
        limits[pairs] = LAWS[law].limit(part, N[pairs])
    return limits


def are_springs(names: Sequence[str] | np.ndarray) -> np.ndarray:
    """Return which pairs are linear springs until they slip or open, (n,) bool.  Local."""
    return np.isin(names, [name for name, kind in LAWS.items() if kind.is_spring])


def initial_guess(names: Sequence[str] | np.ndarray, columns: Columns, before: np.ndarray, du: np.ndarray) -> np.ndarray:
    """Return an initial guess (n, 3) of the motion of pairs after ``before``: ``du``, improved where their law provides a guess.

    Local.
    """
    moved = du.copy()
    for pairs, law, part in _parts(names, columns):
        guess = LAWS[law].initial_guess
        if guess is not None:
            moved[pairs] = guess(part, before[pairs], du[pairs])
    return moved


def sliders_of(names: Sequence[str] | np.ndarray, columns: Columns) -> dict[str, np.ndarray]:
    """Return the columns of the parallel elastic-Coulomb elements of pairs; empty if no pair has such elements.  Local.

    (n, n_elements) each, w0 (n, n_elements, 2); NaN where a pair has fewer elements.  The friction limit of an element is
    max(0, limit - rate du_z), in each direction or on a circle, as that of its pair.
    """
    sliders: list[tuple[np.ndarray, dict[str, np.ndarray]]] = []
    for pairs, law, part in _parts(names, columns):
        of_pairs = LAWS[law].of_columns(part)
        if isinstance(of_pairs, BundleLaw) and len(pairs):
            bundle, elements = of_pairs.bundle, of_pairs.bundle.elements
            of_elements = {"k_t": elements.k_t, "limit": elements.mu * elements.N0, "rate": elements.mu * elements.k_n}
            parts = {name: bundle.of_elements(values) for name, values in of_elements.items()}
            sliders.append((pairs, parts | {"w0": elements.w0.reshape(len(pairs), -1, 2)}))
    most = max((values["k_t"].shape[1] for _, values in sliders), default=0)
    merged = {
        name: np.full((len(names), most, *values.shape[2:]), np.nan) for _, part in sliders for name, values in part.items()
    }
    for pairs, part in sliders:
        for name, values in part.items():
            merged[name][pairs, : values.shape[1]] = values
    return merged


def _parts(names: Sequence[str] | np.ndarray, columns: Columns) -> Iterator[tuple[np.ndarray, str, Columns]]:
    """Yield the pairs of each law and number of sliders, the name of the law, and the columns of the pairs."""
    of_pairs = np.asarray(names, dtype=str)
    sliders = np.nan_to_num(columns.get("sliders", np.zeros(len(of_pairs))))
    for law in [name for name in LAWS if name in of_pairs] or [ELASTIC_COULOMB]:
        for n_sliders in np.unique(sliders[of_pairs == law]) if len(of_pairs) else (0.0,):
            pairs = np.flatnonzero((of_pairs == law) & (sliders == n_sliders))
            everything = slice(None) if len(pairs) == len(of_pairs) else pairs
            yield pairs, law, {name: values[everything] for name, values in columns.items()}


def columns_on_area(law: str, keys: Keys, area: np.ndarray) -> dict[str, np.ndarray]:
    """Return the columns of the pairs of a joint of surfaces by their law, (n,) each; ``keys`` are per area.  Local."""
    return {**columns_of_joint(law, keys, len(area)), **LAWS[law].on_area(keys, area)}


def columns_of_joint(law: str, keys: Keys, n_pairs: int) -> dict[str, np.ndarray]:
    """Return the columns of the law of a joint that are the same for all its pairs, (n,) each.  Local."""
    columns = {**LAWS[law].law_columns(keys), **({"start": keys["start"]} if keys.get("start") else {})}
    return {name: np.full(n_pairs, float(value)) for name, value in columns.items()}


def joined(parts: Sequence[tuple[int, Mapping[str, np.ndarray]]]) -> dict[str, np.ndarray]:
    """Return the columns of all joints concatenated, NaN for the pairs of a joint without the column.  Local."""
    names = sorted({name for _, columns in parts for name in columns})
    return {name: np.concatenate([columns.get(name, np.full(n, np.nan)) for n, columns in parts]) for name in names}
