"""Linear equations between displacements from model files: each determines one dependent degree of freedom.

Degrees of freedom are numbered by places as in ``ties``; nodes outside the elements come after all places.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..formats.model import Equations
from ..messages.errors import MeshError
from .data import Mesh

_NOTHING = 1e-10  # of the largest coefficient of an equation: rounding left by the elimination
_UNBALANCED = 1e-6  # residual of an equation under a unit translation above which it is not fulfilled


@dataclass(frozen=True, eq=False)
class Solved:
    """Degrees of freedom made dependent by equations, including nodes outside the elements."""

    dependent: np.ndarray  # (m,) ascending
    weights: sp.csr_matrix  # (m, n_dof) of independent degrees of freedom
    grounded: np.ndarray  # (n,) degrees of freedom of equations that a rigid motion violates: they act as supports
    joined: np.ndarray  # (2, n) connected degrees of freedom


def solve_equations(
    mesh: Mesh, points: Sequence[str], is_fixed: np.ndarray, dependent: np.ndarray, weights: sp.csr_matrix
) -> Solved:
    """Return the dependences by the equations of a mesh, docs/theory.md, eq. (2.9).  Local, rank 0.

    Degrees of freedom outside the elements become dependent if possible; otherwise the first term of an equation does, as in the
    programs that write them.  ``is_fixed`` (3 (n_places + n_outside),) bool: held by supports; ``dependent`` with ``weights``
    (m, 3 (n_places + n_outside)): already dependent.  Redundant equations are ignored.  ``points`` are the names of the points:
    places are the nodes of the mesh, then two per point.

    Raises
    ------
    MeshError : an equation of a point that does not exist
    """
    equations = mesh.equations
    assert equations is not None, "a mesh with equations"
    n_dof, n_places = len(is_fixed), len(mesh.points) + 2 * len(points)
    rows: dict[int, dict[int, float]] = {}
    known = {
        int(dof): (weights.indices[a:b], weights.data[a:b])
        for dof, a, b in zip(dependent, weights.indptr, weights.indptr[1:], strict=False)
    }
    is_outside = np.arange(n_dof) >= 3 * n_places
    order = []
    for terms in _terms(mesh, equations, points):
        left = _substituted(terms, is_fixed, known, rows)
        size = max((abs(value) for value in terms.values()), default=0.0)
        left = {dof: value for dof, value in left.items() if abs(value) > _NOTHING * size}
        if not left:
            continue  # a redundant equation
        pivot = next((dof for dof in left if is_outside[dof]), next(iter(left)))
        value = left.pop(pivot)
        rows[pivot] = {dof: -other / value for dof, other in left.items()}
        order.append(pivot)
    for pivot in reversed(order):  # insert later pivots into the earlier rows
        rows[pivot] = _substituted(rows[pivot], is_fixed, known, rows)
    return _solved(mesh, n_places, rows, n_dof)


def _terms(mesh: Mesh, equations: Equations, points: Sequence[str]):
    """Yield the terms of each equation, coefficients by degree of freedom."""
    missing = [name for name in equations.points if name not in points]
    if missing:
        raise MeshError(
            f"{mesh.path}: an equation of the file is between points, and the scene has no point {missing[0]!r}; take over its "
            '"points", too, or leave out its "equations" ([model] take)'
        )
    n_nodes = len(mesh.points)
    first = np.array([n_nodes + 2 * list(points).index(name) for name in equations.points], dtype=np.int64)
    nodes = np.where(equations.nodes < n_nodes, equations.nodes, equations.nodes + 2 * len(points))
    of_point = equations.nodes < 0
    nodes[of_point] = first[-1 - equations.nodes[of_point]] + equations.axes[of_point] // 3
    axes = equations.axes % 3
    bounds = np.searchsorted(equations.equation, np.arange(len(equations.where) + 1))
    for begin, end in zip(bounds, bounds[1:], strict=False):
        terms: dict[int, float] = {}
        for dof, value in zip(3 * nodes[begin:end] + axes[begin:end], equations.coefficients[begin:end], strict=True):
            terms[int(dof)] = terms.get(int(dof), 0.0) + float(value)
        yield terms


def _substituted(terms, is_fixed, known, rows) -> dict[int, float]:
    """Return the terms of independent degrees of freedom; held ones are 0."""
    substituted: dict[int, float] = {}
    waiting = list(terms.items())[::-1]
    while waiting:
        dof, value = waiting.pop()
        if is_fixed[dof]:
            continue
        if dof in rows:
            waiting += [(other, value * weight) for other, weight in rows[dof].items()]
        elif dof in known:
            waiting += [(int(other), value * weight) for other, weight in zip(*known[dof], strict=True)]
        else:
            substituted[dof] = substituted.get(dof, 0.0) + value
    return substituted


def _solved(mesh: Mesh, n_places: int, rows: dict[int, dict[int, float]], n_dof: int) -> Solved:
    dependent = np.array(sorted(rows), dtype=np.int64)
    counts = [len(rows[int(dof)]) for dof in dependent]
    columns = np.array([other for dof in dependent for other in rows[int(dof)]], dtype=np.int64)
    values = np.array([value for dof in dependent for value in rows[int(dof)].values()])
    weights = sp.csr_matrix((values, columns, np.concatenate([[0], np.cumsum(counts)])), (len(dependent), n_dof))
    joined = np.stack([np.repeat(dependent, counts), columns])
    return Solved(dependent, weights, _holding(mesh, n_places, dependent, weights), joined)


def _holding(mesh: Mesh, n_places: int, dependent: np.ndarray, weights: sp.csr_matrix) -> np.ndarray:
    """Return the degrees of freedom of equations that a translation of the whole structure violates."""
    motion = translations(len(mesh.points), n_places, weights.shape[1])
    return dependent[abs(motion[dependent] - weights @ motion).max(axis=1, initial=0.0) > _UNBALANCED]


def translations(n_nodes: int, n_places: int, n_dof: int) -> np.ndarray:
    """Return the three translations of the whole structure, (n_dof, 3), without rotations of points.  Local."""
    motion = np.tile(np.eye(3), (n_dof // 3, 1))
    is_turn = np.zeros(n_dof // 3, dtype=bool)
    is_turn[n_nodes + 1 : n_places : 2] = True
    motion[np.repeat(is_turn, 3)] = 0.0
    return motion
