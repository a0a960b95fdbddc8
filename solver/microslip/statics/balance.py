"""Equilibrium at rest: forces across each joint and on each body (docs/theory.md, (12.15))."""

from dataclasses import dataclass

import numpy as np

from ..assembly.reactions import Acting
from ..linear.factor import RESIDUAL_LIMIT, ROUNDING_LIMIT
from ..mesh.connected import connected_parts
from ..mesh.cyclic import rotation, turned_about
from ..mesh.data import ContactPairs
from ..messages.errors import ConvergenceError
from ..messages.words import listed, place, rounded
from ..parallel.agree import on_root
from ..tables.cyclic import Cyclic
from .equilibrium import TOLERANCE, Rest
from .loaded import Loaded

_ROUNDING = 1e-9  # of the forces: smaller values are shown as 0


@dataclass(frozen=True, eq=False)
class JointsAtRest:
    """Resultant forces of joints at rest, the same on every rank; each row a force [N] and its moment [N m]."""

    names: tuple[str, ...]
    about: np.ndarray  # (n_joints, 3) m, the middle of each joint's area, about which moments are
    on_first: np.ndarray  # (n_joints, 6) on the body of the first surface, at its nodes
    on_second: np.ndarray  # (n_joints, 6) on the body of the second surface, or on ground
    size: np.ndarray  # (n_joints,) N, the sum of the magnitudes
    reach: np.ndarray  # (n_joints,) m, from the middle to the farthest point


@dataclass(frozen=True, eq=False)
class BodiesAtRest:
    """Resultant forces on bodies (tied bodies count as one), the same on every rank; each row a force [N] and moment [N m]."""

    names: tuple[str, ...]
    about: np.ndarray  # (n_bodies, 3) m, the mean of the nodes, about which moments are
    loads: np.ndarray  # (n_bodies, 6) loads of [statics]
    joints: np.ndarray  # (n_bodies, 6) contact forces without stated preloads, which are self-equilibrated
    supports: np.ndarray  # (n_bodies, 6) forces of supports, springs to ground and equations
    size: np.ndarray  # (n_bodies,) N, the largest sum of magnitudes of the three
    reach: np.ndarray  # (n_bodies,) m, from the middle to the farthest node

    @property
    def left(self) -> np.ndarray:
        """Imbalance of force [N] and moment [N m], (n_bodies, 6)."""
        return self.loads + self.joints + self.supports


@dataclass(frozen=True, eq=False)
class Balance:
    """The equilibrium of a state of rest."""

    joints: JointsAtRest
    bodies: BodiesAtRest


def balance_of(loaded: Loaded, rest: Rest, acting: Acting | None) -> Balance:
    """Return forces and moments across joints and on bodies at rest, eq. (12.15), the same on every rank.

    Collective on ``loaded.system.comm``.  ``acting`` is used on rank 0.

    Raises
    ------
    ConvergenceError : the imbalance of forces exceeds the limit of an accepted solve; on every rank
    """

    def checked() -> Balance:
        assert acting is not None and loaded.mesh is not None, "rank 0 of a structure with a mesh"
        balance = Balance(_of_joints(loaded.pairs, rest, acting, loaded.cyclic), _of_bodies(loaded, rest, acting))
        check_balance(loaded, rest, balance)
        return balance

    return on_root(loaded.system.comm, checked)


def _of_joints(pairs: ContactPairs, rest: Rest, acting: Acting, cyclic: Cyclic | None) -> JointsAtRest:
    """Return the resultant forces of joints, including stated preloads; second sides in the next sector act where it lies."""
    sides = pairs.sides(len(acting.places))
    on_first = -_in_model_axes(pairs, rest.force)
    in_next_sector = acting.places
    if cyclic is not None:
        in_next_sector = turned_about(acting.places, rotation(cyclic.axis, cyclic.angle), cyclic.axis_point)
    rows: list[tuple] = []
    for name, of_joint in pairs.by_joint().items():
        about = np.average(pairs.position[of_joint], axis=0, weights=pairs.area[of_joint])
        places = acting.places, in_next_sector if pairs.next_sector[of_joint].any() else acting.places
        first, second = (
            _resultant(at, side[of_joint].T @ (sign * on_first[of_joint]), about)
            for side, sign, at in zip(sides, (1.0, -1.0), places)
        )
        second = second if sides[1][of_joint].nnz else -first  # ground
        size = np.linalg.norm(rest.force[of_joint], axis=1).sum()
        rows.append((name, about, first, second, size, _farthest(pairs.position[of_joint], about)))
    return JointsAtRest(*_columns(rows, (str, 3, 6, 6, 0, 0)))


def _of_bodies(loaded: Loaded, rest: Rest, acting: Acting) -> BodiesAtRest:
    """Return the resultant forces on each body; tied bodies count as one."""
    mesh, constraints, n_nodes = loaded.mesh, loaded.system.constraints, len(acting.places)
    assert mesh is not None, "rank 0 of a structure with a mesh"
    part, part_names = connected_parts(mesh, loaded.body_of)
    tied = np.arange(len(part_names)) if constraints is None else constraints.tied_bodies
    of_points = tied[part[list(() if constraints is None else constraints.group_nodes)]]
    contact = _contact_on_nodes(loaded.pairs, rest, n_nodes, loaded.cyclic)
    on_supports = np.where(acting.is_restrained, acting.resisted - acting.loads - contact, 0.0)
    rows: list[tuple] = []
    for i in np.unique(tied):
        nodes, of_body = np.flatnonzero(tied[part] == i), np.flatnonzero(of_points == i)
        about, at = mesh.points[nodes].mean(axis=0), acting.places[nodes]
        on_points = _resultant(acting.points[of_body], acting.on_points[of_body, :3], about)
        on_points[3:] += acting.on_points[of_body, 3:].sum(axis=0)
        loads, joints, supports = (_resultant(at, forces[nodes], about) for forces in (acting.loads, contact, on_supports))
        sizes = [np.linalg.norm(forces[nodes], axis=1).sum() for forces in (acting.loads, contact, on_supports)]
        sizes[0] += np.linalg.norm(acting.on_points[of_body, :3], axis=1).sum()
        name = listed([part_names[k] for k in np.flatnonzero(tied == i)])
        rows.append(
            (name, about, loads + on_points, joints, supports - on_points, max(sizes), _farthest(mesh.points[nodes], about))
        )
    return BodiesAtRest(*_columns(rows, (str, 3, 6, 6, 6, 0, 0)))


def _in_model_axes(pairs: ContactPairs, force: np.ndarray) -> np.ndarray:
    """Return forces (n_pairs, 3) of pair frames along the model's axes."""
    return np.einsum("pji,pj->pi", pairs.frame, force)


def _contact_on_nodes(pairs: ContactPairs, rest: Rest, n_nodes: int, cyclic: Cyclic | None) -> np.ndarray:
    """Return the contact forces on nodes, -R^T f_nl, (n_nodes, 3) [N]; stated preloads are self-equilibrated.

    A second side in the next sector has the nodes of this sector, turned; the forces on it are turned back to them.
    """
    carried = rest.force.copy()
    carried[:, 2] += np.maximum(np.nan_to_num(pairs.N0), 0.0)
    first, second = pairs.sides(n_nodes)
    on_second = _in_model_axes(pairs, carried)
    on_first = on_second.copy()
    if cyclic is not None:
        on_second[pairs.next_sector] = on_second[pairs.next_sector] @ rotation(cyclic.axis, cyclic.angle)
    forces: np.ndarray = second.T @ on_second - first.T @ on_first
    return forces


def _resultant(points: np.ndarray, forces: np.ndarray, about: np.ndarray) -> np.ndarray:
    """Return the sum of forces (n, 3) [N] at points (n, 3) [m] and of their moments about a point, (6,)."""
    return np.concatenate([forces.sum(axis=0), np.cross(points - about, forces).sum(axis=0)])


def _farthest(points: np.ndarray, about: np.ndarray) -> float:
    return float(np.linalg.norm(points - about, axis=1).max())


def _columns(rows: list[tuple], widths: tuple) -> tuple:
    """Return the columns of a table: names as a tuple, numbers as arrays, (n,) or (n, width)."""
    columns = zip(*rows) if rows else ((),) * len(widths)
    return tuple(
        tuple(column) if width is str else np.array(column, dtype=float).reshape(len(rows), *filter(None, (width,)))
        for column, width in zip(columns, widths)
    )


def check_balance(loaded: Loaded, rest: Rest, balance: Balance) -> None:
    """Raise ConvergenceError for a body or a joint whose imbalance exceeds the limit of an accepted solve.  Local."""
    for what, table, force in (("", balance.bodies, balance.bodies.left), ("joint ", balance.joints, _between(balance.joints))):
        sizes = _reference_forces(table.size)
        for i, name in enumerate(table.names):
            left = float(np.linalg.norm(force[i, :3]))
            if not left <= max(ROUNDING_LIMIT * sizes[i], _newton_imbalance(loaded.pairs, rest)):
                shown = repr(name) if what else name
                raise ConvergenceError(
                    f"{loaded.where}{': ' if loaded.where else ''}[statics]: the forces on {what}{shown} are not in balance: of "
                    f"{table.size[i]:.4g} N a force of {rounded(left)} N remains at rest, and rounding leaves up to "
                    f"{ROUNDING_LIMIT:g} of them; compare the joint's stiffnesses with the structure's"
                )


def _reference_forces(size: np.ndarray) -> np.ndarray:
    """Return the reference forces of each joint or body, (n,) [N]: the imbalance of a solve is relative to all forces."""
    return np.maximum(size, RESIDUAL_LIMIT * size.max(initial=0.0))


def _newton_imbalance(pairs: ContactPairs, rest: Rest) -> float:
    """Return the imbalance that the tolerance of (12.3) allows [N]."""
    return TOLERANCE * float(np.abs(rest.du).max(initial=0.0) * np.nansum(pairs.k_n + 2.0 * pairs.k_t))


def _between(joints: JointsAtRest) -> np.ndarray:
    """Return force [N] and moment [N m] by which the two sides of each joint differ, (n_joints, 6)."""
    return joints.on_first + joints.on_second


def in_words(balance: Balance) -> list[str]:
    """Return a line on the forces of each joint, and one on the equilibrium of each body.  Local."""
    return _joints_in_words(balance.joints) + _bodies_in_words(balance.bodies)


def _joints_in_words(joints: JointsAtRest) -> list[str]:
    lines = []
    sizes = _reference_forces(joints.size)
    for i, name in enumerate(joints.names):
        size, reach = sizes[i] or 1.0, joints.reach[i] or 1.0
        off, turned = np.linalg.norm(_between(joints)[i].reshape(2, 3), axis=1) / (size, size * reach)
        carried = f"{_shown(joints.on_first[i, :3], size)} N and {_shown(joints.on_first[i, 3:], size * reach)} N m"
        lines.append(
            f"  {name}: transmits {carried} about {place(joints.about[i])} m to its first side; its two sides differ by "
            f"{off:.1e} of the forces, {turned:.1e} of their moments{_imbalance_warning(off)}"
        )
    return lines


def _bodies_in_words(bodies: BodiesAtRest) -> list[str]:
    lines = []
    sizes = _reference_forces(bodies.size)
    for i, name in enumerate(bodies.names):
        size, reach = sizes[i] or 1.0, bodies.reach[i] or 1.0
        by = {"loads": bodies.loads[i, :3], "joints": bodies.joints[i, :3], "supports": bodies.supports[i, :3]}
        forces = {what: force for what, force in by.items() if np.abs(force).max() > _ROUNDING * size}
        acting = ", ".join(f"{what} {_shown(force, size)} N" for what, force in forces.items())
        left, turned = np.linalg.norm(bodies.left[i].reshape(2, 3), axis=1) / (size, size * reach)
        lines.append(
            f"  {name}: {acting or 'no forces'}; imbalance {left:.1e} of the forces, {turned:.1e} of their moments"
            f"{_imbalance_warning(left)}"
        )
    return lines


def _imbalance_warning(remainder: float) -> str:
    """Return a warning if the imbalance is larger than a solve should leave."""
    return "" if remainder <= RESIDUAL_LIMIT else f": more than the {RESIDUAL_LIMIT:g} that a solve should leave"


def _shown(vector: np.ndarray, size: float) -> str:
    """Return three numbers as text; rounding relative to ``size`` is shown as 0."""
    return place(np.where(np.abs(vector) > _ROUNDING * size, vector, 0.0))
