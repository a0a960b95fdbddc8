"""What a result file holds, as arrays: the same classes are written and read.  NumPy only.

n points of a level, n_pairs contact pairs, n_outputs outputs, N_H = 2 H + 1 coefficients (mean, cos 1, sin 1, ...).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..continuation.branch import Point

COMPLETE, STOPPED, RUNNING = "complete", "failed", "running"


@dataclass(frozen=True)
class LinearCurve:
    """The response with all pairs stuck, per unit level."""

    frequency: np.ndarray  # (n_linear,) Hz
    response: np.ndarray  # (n_linear, n_outputs, N_H) m/N


@dataclass(frozen=True)
class LevelResult:
    """The converged points of one level, in the order of the branch."""

    level: float  # N
    status: str  # COMPLETE, STOPPED, RUNNING
    failure: str  # why the curve ends early; "" otherwise
    frequency: np.ndarray  # (n,) Hz
    response: np.ndarray  # (n, n_outputs, N_H) m
    energy: np.ndarray  # (n, n_pairs) friction loss, J per cycle
    state: np.ndarray  # (n, n_pairs) uint8: 0 stick, 1 slip, 2 open
    friction: np.ndarray  # (n,) J per cycle
    damping: np.ndarray  # (n,) J per cycle
    input: np.ndarray  # (n,) J per cycle
    unknowns: np.ndarray  # (n,)
    newton: np.ndarray  # (n,)
    krylov: np.ndarray  # (n,)
    seconds: np.ndarray  # (n,)
    harmonics: np.ndarray  # (n,) the highest of each point
    samples: np.ndarray  # (n,) a period
    asked: np.ndarray  # (n,) 1 where the frequency is one of [response] at
    segment: np.ndarray  # (n,) 0 from the start; 1 from the other end of the range, where segment 0 ended early
    notes: np.ndarray  # (n,) of str
    du: np.ndarray | None  # (n, n_pairs, 3, N_H) relative displacement, m; None where it was not read
    p: np.ndarray | None  # (n, n_pairs, 3, N_H) contact force beyond the stuck springs, N; None likewise
    error: np.ndarray | None  # (n, n_outputs, parts) of the error of harmonic 1, m; None where it was not estimated


# dataset of levels/0000/, attribute of LevelResult, attribute of Point, type, unit; frequency_Hz comes from omega
LEVEL_DATA = (
    ("frequency_Hz", "frequency", "omega", "f8", "Hz"),
    ("response", "response", "response", "f8", "m"),
    ("energy_J", "energy", "energy", "f8", "J"),
    ("state", "state", "state", "u1", "0 stick, 1 slip, 2 open"),
    ("friction_J", "friction", "friction", "f8", "J"),
    ("damping_J", "damping", "damping", "f8", "J"),
    ("input_J", "input", "input", "f8", "J"),
    ("unknowns", "unknowns", "unknowns", "i8", "1"),
    ("newton", "newton", "newton", "i8", "1"),
    ("krylov", "krylov", "krylov", "i8", "1"),
    ("seconds", "seconds", "seconds", "f8", "s"),
    ("harmonics", "harmonics", "harmonics", "i8", "1"),
    ("samples", "samples", "samples", "i8", "1"),
    ("asked", "asked", "asked", "u1", "1"),
    ("segment", "segment", "segment", "u1", "0 from the start, 1 from the other end of the range"),
    ("du", "du", "U", "f8", "m"),
    ("p", "p", "p", "f8", "N"),
)
MOTION = ("du", "p")  # the large ones, which pictures do without
ERROR = "error_m"  # (n, n_outputs, parts); only where it was estimated


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
    shapes = {
        "response": (n_outputs, N_H),
        "energy": (n_pairs,),
        "state": (n_pairs,),
        "du": (n_pairs, 3, N_H),
        "p": (n_pairs, 3, N_H),
    }
    arrays = {}
    for _, name, of_point, kind, _ in LEVEL_DATA:
        values = np.array([_padded(getattr(point, of_point), shapes.get(name, ())) for point in points], dtype=kind)
        arrays[name] = values.reshape(len(points), *shapes.get(name, ()))
    arrays["frequency"] = arrays["frequency"] / (2.0 * np.pi)
    estimated = [point.error for point in points if point.error is not None]
    notes = np.array(["; ".join(point.notes) for point in points], dtype=object)
    error = np.array(estimated) if points and len(estimated) == len(points) else None
    return LevelResult(level=level, status=status, failure=failure or "", notes=notes, error=error, **arrays)


def _padded(values, shape: tuple[int, ...]):
    """Return the values of a point with zeros for the harmonics that it lacks."""
    if not shape or np.shape(values)[-1] == shape[-1]:
        return values
    return np.pad(values, [(0, 0)] * (len(shape) - 1) + [(0, shape[-1] - np.shape(values)[-1])])
