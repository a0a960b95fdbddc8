"""What a result file holds, as arrays: the same classes are written and read.  NumPy only.

n_pairs contact pairs, n_outputs outputs, N_H = 2 H + 1 coefficients (mean, cos 1, sin 1, ...).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..continuation.branch import QUANTITIES, Point
from ..continuation.quantities import axis_lengths

COMPLETE, STOPPED, RUNNING = "complete", "failed", "running"


@dataclass(frozen=True)
class LinearCurve:
    """The response with all pairs stuck, per unit level."""

    frequency: np.ndarray  # (n_linear,) Hz
    response: np.ndarray  # (n_linear, n_outputs, N_H) m/N


@dataclass(frozen=True, eq=False)
class LevelResult:
    """The converged points of one level, in the order of the branch.

    Each quantity of :class:`~microslip.continuation.branch.Point` is an attribute by its name, an array (n, ...) of the shape and
    unit that is declared there: ``level.frequency``, ``level.response``, ``level.du``; None where it was not read or computed.
    """

    level: float  # N
    status: str  # COMPLETE, STOPPED, RUNNING
    failure: str  # why the curve ends early; "" otherwise
    arrays: dict[str, np.ndarray | None]

    def __getattr__(self, name: str) -> Any:
        try:
            return self.__dict__["arrays"][name]
        except KeyError:
            raise AttributeError(f"a level has no {name!r}") from None


@dataclass(frozen=True)
class Joint:
    """The contact pairs: mesh.data.ContactPairs with the node numbers of the user's file."""

    names: tuple[str, ...]  # of the joints
    joint: np.ndarray  # (n_pairs,) index into names
    node1: np.ndarray  # (n_pairs,) node number in the user's mesh; -1 is ground, or no mesh
    node2: np.ndarray  # (n_pairs,)
    position: np.ndarray  # (n_pairs, 3) m; NaN where it is not known
    frame: np.ndarray  # (n_pairs, 3, 3) rows x, y (tangential), z (from body 2 into body 1)
    area: np.ndarray  # (n_pairs,) m2; NaN where it is not known
    mu: np.ndarray  # (n_pairs,)
    N0: np.ndarray  # (n_pairs,) N
    k_t: np.ndarray  # (n_pairs,) N/m
    k_n: np.ndarray  # (n_pairs,) N/m
    separate: np.ndarray  # (n_pairs,) 1 where each direction has its own friction limit
    faces: tuple[np.ndarray, ...] = ()  # (n_faces, 3, 4, 6 or 8) indices of pairs

    @property
    def n_pairs(self) -> int:
        return len(self.mu)


# dataset of joint/ and attribute of Joint, shape of a pair, type, unit
JOINT_DATA = (
    ("joint", (), "i8", "index into names"),
    ("node1", (), "i8", "number in the mesh file"),
    ("node2", (), "i8", "number in the mesh file"),
    ("position", (3,), "f8", "m"),
    ("frame", (3, 3), "f8", "1"),
    ("area", (), "f8", "m2"),
    ("mu", (), "f8", "1"),
    ("N0", (), "f8", "N"),
    ("k_t", (), "f8", "N/m"),
    ("k_n", (), "f8", "N/m"),
    ("separate", (), "u1", "1"),
)


@dataclass(frozen=True)
class ResultFile:
    """Everything of a results.h5."""

    path: str
    title: str
    name: str  # of the scene
    method: str
    scene_text: str
    options: tuple[str, ...]  # what followed -- on the command line
    versions: dict[str, str]
    outputs: tuple[str, ...]
    mode_frequency: np.ndarray  # (n_modes,) Hz
    joint: Joint
    linear: LinearCurve | None
    levels: tuple[LevelResult, ...] = field(default_factory=tuple)


def joint_of(pairs, node_numbers: np.ndarray | None = None) -> Joint:
    """Return the record of :class:`~microslip.mesh.data.ContactPairs`; ``node_numbers`` are the user's.  Local."""
    names = tuple(dict.fromkeys(pairs.joint))
    node1, node2 = (_numbers(nodes, node_numbers) for nodes in (pairs.node1, pairs.node2))
    return Joint(
        names,
        np.array([names.index(name) for name in pairs.joint], dtype=np.int64),
        node1,
        node2,
        pairs.position,
        pairs.frame,
        pairs.area,
        pairs.mu,
        pairs.N0,
        pairs.k_t,
        pairs.k_n,
        pairs.separate,
        tuple(pairs.faces),
    )


def _numbers(nodes: np.ndarray, node_numbers: np.ndarray | None) -> np.ndarray:
    nodes = np.asarray(nodes)
    return np.full(len(nodes), -1) if node_numbers is None else np.where(nodes < 0, -1, node_numbers[nodes])


def level_result(
    level: float, points: list[Point], sizes: tuple[int, int, int], status: str = COMPLETE, failure: str | None = None
) -> LevelResult:
    """Return the record of a level's points; ``sizes`` = (n_outputs, n_pairs, N_H).  Local, on rank 0."""
    n_outputs, n_pairs, N_H = sizes
    N_H = max([N_H, *(point.response.shape[-1] for point in points)])  # points may have more harmonics than others
    lengths = axis_lengths(n_outputs, n_pairs, N_H)
    return LevelResult(level, status, failure or "", {kept.name: kept.array(points, lengths) for kept in QUANTITIES})
