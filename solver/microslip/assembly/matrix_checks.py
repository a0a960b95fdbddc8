"""Properties of matrices of another program: symmetry, definiteness, rigid-body motions, mass."""

import numpy as np
import scipy.sparse as sp
import scipy.sparse.csgraph
import scipy.sparse.linalg

from ..messages.words import counted
from .matrix_places import Places

_MOST_FACTORED = 20_000  # rows of a stiffness that is factored for its inertia, a second or so
_SHIFT = 1e-9  # of the diagonal: rounding is no negative eigenvalue
_RIGID = 1e-7  # forces of a motion over the sum of their parts, below which it strains nothing
_MOST_PARTS = 6  # of which a line each
_HEAVIEST, _LIGHTEST = 23_000.0, 0.1  # kg/m3 of any solid, over the box of the model
_MOTIONS = ("along x", "along y", "along z", "about x", "about y", "about z")


def messages_on_matrices(K: sp.csr_matrix, M: sp.csr_matrix, skew: dict[str, float], places: Places | None) -> list[str]:
    """Return lines for the log and ``check``.  Local.

    ``skew`` has the largest |A - A^T| of each matrix as it was read, over its largest entry.
    """
    lines = ["symmetry: " + ", ".join(f"{key} {value:.1e}" for key, value in skew.items()) + " of the largest entry"]
    lines.append(definiteness(K))
    if places is not None:
        motions, names = rigid_motions(places)
        lines += _of_motions(K, M, motions, names, places)
        lines += _density(M, motions, names, places)
    return lines


def definiteness(K: sp.csr_matrix) -> str:
    """Return a line on the negative eigenvalues of the stiffness, counted by its pivots (Sylvester's law of inertia).  Local."""
    diagonal = K.diagonal()
    if (diagonal < 0.0).any():
        return f"stiffness: not positive semi-definite, row {int(np.argmin(diagonal))} has {diagonal.min():.3g} on the diagonal"
    if K.shape[0] > _MOST_FACTORED:
        return f"stiffness: definiteness is determined by its factor, in the run (more than {_MOST_FACTORED} rows)"
    n = negative_pivots(K + sp.diags(_SHIFT * np.where(diagonal > 0.0, diagonal, diagonal.max(initial=1.0))))
    if n is None:
        return "stiffness: definiteness is determined by its factor, in the run"
    return "stiffness: no negative eigenvalue" if n == 0 else f"stiffness: {n} negative eigenvalues, not positive semi-definite"


def negative_pivots(A: sp.spmatrix) -> int | None:
    """Return the number of negative eigenvalues of a symmetric matrix; None where rows had to be exchanged.  Local."""
    try:
        factor = scipy.sparse.linalg.splu(
            A.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
    except RuntimeError:  # singular
        return None
    if not np.array_equal(factor.perm_r, factor.perm_c):
        return None
    return int(np.count_nonzero(factor.U.diagonal() < 0.0))


def rigid_motions(places: Places) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return rigid motions of all nodes on the rows of the matrices, (n_dof, 3 or 6), and their names.  Local.

    Rotations are about the middle of the nodes; none where their places are unknown.  With a recovery matrix, rows that belong
    to no node take no part.
    """
    points = places.mesh.points
    has_place = np.isfinite(points).all(axis=1)
    n_dof = places.expand.shape[1]
    fields = [np.tile(axis, (len(points), 1)) for axis in np.eye(3)]
    if has_place.all() and len(points):
        arms = points - points.mean(axis=0)
        fields += [np.cross(axis, arms) for axis in np.eye(3)]
    motions = np.zeros((n_dof, len(fields)))
    is_row = (places.dof >= 0) & (places.dof < n_dof)
    for column, values in enumerate(fields):
        motions[places.dof[is_row], column] = values[is_row]
    return motions, _MOTIONS[: len(fields)]


def _of_motions(K: sp.csr_matrix, M: sp.csr_matrix, motions: np.ndarray, names: tuple[str, ...], dofs: Places) -> list[str]:
    """Return lines on the rigid-body motions without strain, by connected part of the stiffness, and the mass along each axis."""
    _, part = scipy.sparse.csgraph.connected_components(K, directed=False)
    moving = [number for number in np.unique(part[motions.any(axis=1)])]
    forces, parts = np.abs(K @ motions), abs(K) @ abs(motions)
    lines = []
    for number in moving[:_MOST_PARTS]:
        rows = part == number
        ratio = forces[rows].max(axis=0) / np.maximum(parts[rows].max(axis=0), np.finfo(float).tiny)
        free = [name for name, value in zip(names, ratio) if value < _RIGID]
        summary = f"{len(free)} of {len(names)} rigid motions strain nothing ({', '.join(free)})" if free else "it is held"
        where = "" if len(moving) == 1 else f"part of {counted(rows.sum(), 'row')} with {dofs.name_of(int(np.argmax(rows)))}: "
        lines.append(f"stiffness: {where}{summary}")
    if len(moving) > _MOST_PARTS:
        lines.append(f"stiffness: {len(moving) - _MOST_PARTS} further parts")
    mass = np.einsum("di,di->i", motions[:, :3], M @ motions[:, :3])
    return [*lines, f"mass: {mass[0]:.6g}, {mass[1]:.6g}, {mass[2]:.6g} kg along x, y, z (of rows with a node)"]


def _density(M: sp.csr_matrix, motions: np.ndarray, names: tuple[str, ...], places: Places) -> list[str]:
    """Return a line where the mass over the box of the nodes is that of no solid: units that are not SI."""
    if len(names) < 6:
        return []
    box = float(np.prod(np.ptp(places.mesh.points, axis=0)))
    mass = float(motions[:, 0] @ (M @ motions[:, 0]))
    if box <= 0.0 or _LIGHTEST <= mass / box <= _HEAVIEST:
        return []
    return [
        f"units: {mass:.3g} kg in a box of {box:.3g} m3 is {mass / box:.3g} kg/m3; are the matrices in N, m and kg, and the "
        "nodes in m? A model in N, mm and t needs its stiffness times 1000, its mass times 1000, its nodes times 0.001"
    ]
