"""Points connected to a group of nodes, rigidly or by the weighted mean of its motion.

Degrees of freedom are numbered as in ``ties``.
"""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from .. import elements
from ..messages.errors import MeshError
from ..messages.words import counted
from ..parallel.ownership import rows_of
from ..tables.structure import Point
from .data import Mesh
from .surface import outward_faces
from .ties import Follower

_SLENDER = 1e-8  # ratio of smallest to largest second moment below which the nodes of a group lie on a line


def of_rigid(mesh: Mesh, point: Point, at: int, n_places: int) -> Follower:
    """Return the dependence of the nodes of a group on a point as a rigid body: docs/theory.md, eq. (2.7)."""
    nodes = mesh.node_groups[point.group]
    if not _is_turned(mesh, point):
        _second_moments(mesh, point.group, nodes, np.ones(len(nodes)) / len(nodes), _what(mesh, point))
    arms = mesh.points[nodes] - np.array(point.position)
    blocks = np.concatenate([np.tile(np.eye(3), (len(nodes), 1, 1)), -_cross(arms)], axis=2).reshape(-1, 6)
    columns = np.arange(3 * at, 3 * at + 6)
    rows = np.repeat(np.arange(3 * len(nodes)), 6)
    weights = sp.csr_matrix((blocks.ravel(), (rows, np.tile(columns, 3 * len(nodes)))), (3 * len(nodes), 3 * n_places))
    weights.eliminate_zeros()
    note = f"point {point.name!r}: {counted(len(nodes), 'node')} of {point.group!r} follow it as a rigid body"
    return Follower(f"point {point.name!r}", rows_of(nodes), weights, _star(nodes), note)


def of_distributing(mesh: Mesh, point: Point, at: int, n_places: int) -> Follower:
    """Return the dependence of a point on the weighted mean of its nodes: docs/theory.md, eq. (2.8)."""
    nodes = mesh.node_groups[point.group]
    share = _shares_of(mesh, point, nodes)
    J, centre = _second_moments(mesh, point.group, nodes, share, _what(mesh, point))
    arms = mesh.points[nodes] - centre
    turn = np.linalg.inv(J) @ (share[:, None, None] * _cross(arms))  # (n, 3, 3): theta = sum turn_i u_i
    move = share[:, None, None] * np.eye(3) - _cross(np.array(point.position) - centre) @ turn
    blocks = np.concatenate([move, turn], axis=1).transpose(1, 0, 2).reshape(6, -1)
    rows = np.repeat(np.arange(6), 3 * len(nodes))
    weights = sp.csr_matrix((blocks.ravel(), (rows, np.tile(rows_of(nodes), 6))), (6, 3 * n_places))
    weights.eliminate_zeros()
    note = f"point {point.name!r} follows the mean of {counted(len(nodes), 'node')} of {point.group!r}"
    return Follower(f"point {point.name!r}", np.arange(3 * at, 3 * at + 6), weights, _star(nodes), note)


def _shares_of(mesh: Mesh, point: Point, nodes: np.ndarray) -> np.ndarray:
    """Return the weights of a point's nodes, (n,), with sum 1.

    Raises
    ------
    MeshError : weights that are not one for each node
    """
    if point.weights == "area":
        return _shares(mesh, point.group, nodes)
    if point.weights == "equal":
        return np.full(len(nodes), 1.0 / len(nodes))
    if len(point.weights) != len(nodes):
        raise MeshError(
            f"{_what(mesh, point)}: weights holds {counted(len(point.weights), 'number')} for "
            f"{counted(len(nodes), 'node')} of {point.group!r}"
        )
    share = np.empty(len(nodes))
    share[np.argsort(mesh.numbers[nodes])] = point.weights
    return share / share.sum()


def _is_turned(mesh: Mesh, point: Point) -> bool:
    """Return whether equations of the model file have independent terms of all three rotations of a point."""
    equations = mesh.equations
    if equations is None or point.name not in equations.points:
        return False
    turns = (equations.nodes == -1 - equations.points.index(point.name)) & (equations.axes >= 3)
    rows = np.zeros((len(equations.where), 3))
    np.add.at(rows, (equations.equation[turns], equations.axes[turns] - 3), equations.coefficients[turns])
    return bool(np.linalg.matrix_rank(rows) == 3)


def of_equations(mesh: Mesh, point: Point, at: int, n_places: int) -> Follower:
    """Return no dependence: equations of the model file connect the point, which counts as one of the body of its group.

    Local, rank 0.

    Raises
    ------
    MeshError : no equation of the file has the point
    """
    if mesh.equations is None or point.name not in mesh.equations.points:
        raise MeshError(
            f'{_what(mesh, point)} has connection = "equations", and no equation of the model file names it; connect it as '
            '"rigid" or "distributing"'
        )
    none, weights = np.zeros(0, dtype=np.int64), sp.csr_matrix((0, 3 * n_places))
    note = f"point {point.name!r} has no nodes of its own: equations of the file connect it"
    return Follower(f"point {point.name!r}", none, weights, _star(mesh.node_groups[point.group]), note)


def forces_of_moment(mesh: Mesh, group: str, moment: Sequence[float], what: str) -> np.ndarray:
    """Return nodal forces of a group with a given moment and no resultant, as from a distributing point, (n, 3) [N].

    Local, rank 0.  docs/theory.md, eq. (2.8).  ``what``: name in messages.

    Raises
    ------
    MeshError : the nodes lie on a line
    """
    nodes = mesh.node_groups[group]
    share = _shares(mesh, group, nodes)
    J, centre = _second_moments(mesh, group, nodes, share, what)
    return share[:, None] * np.cross(np.linalg.solve(J, np.asarray(moment, dtype=float)), mesh.points[nodes] - centre)


def _what(mesh: Mesh, point: Point) -> str:
    return f"{mesh.path}: point {point.name!r}"


def _shares(mesh: Mesh, group: str, nodes: np.ndarray) -> np.ndarray:
    """Return the weights of the nodes, (n,): tributary areas if the group has outer faces, otherwise equal weights."""
    total = np.zeros(len(mesh.points))
    try:
        faces = outward_faces(mesh, group)
    except MeshError:  # no faces
        faces = {}
    for kind, nodes_of_faces in faces.items():
        np.add.at(total, nodes_of_faces, elements.face_nodal_areas(kind, mesh.points[nodes_of_faces]))
    share = total[nodes] if (total[nodes] > 0.0).all() else np.ones(len(nodes))
    return share / share.sum()


def _second_moments(mesh: Mesh, group: str, nodes: np.ndarray, share: np.ndarray, what: str) -> tuple[np.ndarray, np.ndarray]:
    """Return second moments J (3, 3) [m2] of the nodes about their centre, and the centre; MeshError for collinear nodes."""
    centre = share @ mesh.points[nodes]
    arms = mesh.points[nodes] - centre
    J = np.einsum("n,nij->ij", share, -_cross(arms) @ _cross(arms))
    least, *_, most = np.linalg.eigvalsh(J)
    if not least > _SLENDER * most:
        raise MeshError(
            f"{what}: the {len(nodes)} nodes of {group!r} lie on a line, about which nothing there bears a moment, and they "
            "could turn freely; name a group of three nodes at least that do not"
        )
    return J, centre


def _cross(r: np.ndarray) -> np.ndarray:
    """Return the matrices [r] (..., 3, 3) with [r] v = r x v."""
    x, y, z = np.moveaxis(np.asarray(r, dtype=float), -1, 0)
    zero = np.zeros_like(x)
    return np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), (0, 1), (-2, -1))


def _star(nodes: np.ndarray) -> np.ndarray:
    return np.stack([np.full(len(nodes), nodes[0]), nodes])
