"""Loads as forces on nodes: shared by nodes, a pressure whose phase may vary, forces from a file (docs/theory.md, section 13).

A load whose phase varies over the structure is two real shapes: with complex nodal forces f = f_re + i f_im at unit level,

    Re(f e^(i (n omega t + phase))) = f_re cos(n omega t + phase) + f_im cos(n omega t + phase + pi / 2).
"""

from dataclasses import dataclass

import numpy as np

from .. import elements
from ..mesh.data import Mesh
from ..mesh.links import Links, places_of
from ..mesh.surface import outward_faces
from ..tables.structure import Model
from ..tables.vibration import Load
from .force_file import forces_on_nodes


@dataclass(frozen=True)
class NodalForces:
    """What a load does at unit level, as real shapes; ``Load.phases`` are their phases."""

    nodes: np.ndarray  # (n,) index into Mesh.points, or the place of a point; a node may be there several times
    shapes: tuple[np.ndarray, ...]  # (n, 3) N each


def nodal_forces(mesh: Mesh, load: Load, model: Model, where: str, links: Links | None = None) -> NodalForces:
    """Return the forces of a load, docs/theory.md, eq. (13.1); none of a base that accelerates: assemble.py.  Local, rank 0.

    ``model`` has the axis of an engine order; ``where`` names the load in messages.

    Raises
    ------
    MeshError, CaseError : a place without a node, a group that is no surface, a file at fault
    """
    if load.base_acceleration is not None:
        return NodalForces(np.zeros(0, dtype=int), (np.zeros((0, 3)),))
    if load.pressure is not None:
        return _of_pressure(mesh, load, model)
    path = load.file_of("forces")
    if path is not None:
        nodes, forces = forces_on_nodes(path, mesh.numbers)
        return NodalForces(nodes, (forces.real, forces.imag))
    nodes = places_of(mesh, links, load, where)
    force = np.asarray(load.direction or load.moment, dtype=float)
    return NodalForces(nodes, (np.tile(force / len(nodes), (len(nodes), 1)),))


def _of_pressure(mesh: Mesh, load: Load, model: Model) -> NodalForces:
    """Return the forces of a pressure, consistent with the shapes of its faces; its phase is that at their quadrature points."""
    if load.pressure is None or load.group is None:
        raise ValueError("a pressure acts on a group of faces")
    nodes, forces = [], []
    for kind, faces in outward_faces(mesh, load.group).items():
        points = mesh.points[faces]
        turned = load.pressure * np.exp(1j * phase_at(elements.face_points(kind, points), load, model))
        parts = [elements.pressure_forces(kind, points, part).reshape(-1, 3) for part in (turned.real, turned.imag)]
        nodes.append(faces.ravel())
        forces.append(np.stack(parts))
    return NodalForces(np.concatenate(nodes), tuple(np.concatenate(forces, axis=1)[: len(load.phases)]))


def phase_at(points: np.ndarray, load: Load, model: Model) -> np.ndarray:
    """Return the phase of a pressure at points (..., 3), (...) [rad]: k . x, or engine order times angle; else 0.  Local."""
    if load.travelling is not None:
        return points @ np.asarray(load.travelling)
    if load.engine_order is not None:
        return load.engine_order * angle_about(points, model.axis, model.axis_point)
    return np.zeros(points.shape[:-1])


def angle_about(points: np.ndarray, axis, axis_point) -> np.ndarray:
    """Return the angle of points (..., 3) about an axis, right-handed, (...) [rad].  Local.

    It counts from the model axis that follows the one nearest to the axis (x about z, y about x, z about y), projected.
    """
    a = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    start = np.eye(3)[(int(np.argmax(np.abs(a))) + 1) % 3]
    e1 = start - (start @ a) * a
    e1 /= np.linalg.norm(e1)
    r = points - np.asarray(axis_point, dtype=float)
    return np.arctan2(r @ np.cross(a, e1), r @ e1)
