"""Detection of a sector of a disc: stated by the file, or two named faces of which one is a turned copy of the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from ... import elements
from ...formats.model import FileModel
from ...mesh.cyclic import faces_fit, rotation
from ...mesh.data import Mesh
from ...mesh.surface import nodes_of, outward_faces
from ...messages.errors import MeshError
from ...tables.cyclic import Cyclic
from ...tables.structure_tables import StructureTables
from ...tables.table import Vector
from ...tables.units import times

MOST_SECTORS = 400  # for more, two faces count as parallel
_MOST_GROUPS = 200
_ALIKE = 0.02  # relative difference of areas, and of the angle from 2 pi / N
_WORDS = ("cyc", "low", "high", "sector", "period", "m01", "left", "right")  # in names of such faces


@dataclass(frozen=True)
class Sector:
    """The table [cyclic] of a first scene."""

    cyclic: Cyclic
    of_file: bool  # stated by the file; otherwise from the fit of the faces
    is_likely: bool  # from the file or the names of the faces

    @property
    def text(self) -> str:
        """Return a description."""
        low, high = self.cyclic.faces or ("", "")
        origin = "as the file states" if self.of_file else f"a turn of {360.0 / self.cyclic.sectors:.6g} degrees fits them"
        return f"sector of {self.cyclic.sectors}: {low} to {high}, {origin}"


@dataclass(frozen=True)
class _Face:
    """A named face of the mesh."""

    name: str
    nodes: np.ndarray
    vector: np.ndarray  # (3,) integral of the outward normal [m2]
    area: float  # m2
    centre: np.ndarray  # (3,) m

    @classmethod
    def of(cls, mesh: Mesh, name: str) -> _Face | None:
        """Return the face of a group; None without outer faces.  Local, rank 0."""
        try:
            faces = outward_faces(mesh, name)
        except MeshError:
            return None
        normal, area, moment = np.zeros(3), 0.0, np.zeros(3)
        for kind, nodes in faces.items():
            points = mesh.points[nodes]
            shares = elements.face_nodal_areas(kind, points)
            normal += np.einsum("fn,fni->i", shares, elements.face_normals(kind, points))
            moment += np.einsum("fn,fni->i", shares, points)
            area += float(shares.sum())
        nodes = nodes_of(faces)
        return cls(name, nodes, normal, area, moment / area)


def sector_of(mesh: Mesh, file: FileModel, settings: StructureTables) -> Sector | None:
    """Return the sector stated by a file or formed by two of its named faces; None if there is none.  Local, rank 0."""
    stated = file.cyclic
    names = [name for name, nodes in mesh.node_groups.items() if name not in settings.body_of and len(nodes)]
    if stated is not None and stated.faces is not None:
        if stated.sectors is not None and stated.axis is not None and stated.axis_point is not None:
            point = times(stated.axis_point, settings.model.metres)
            axis, faces = stated.axis, stated.faces
            return Sector(Cyclic(sectors=stated.sectors, axis=axis, axis_point=point, faces=faces, engine_order=1), True, True)
        names = [name for name in stated.faces if name in mesh.node_groups]
    sides = [side for name in names[:_MOST_GROUPS] if (side := _Face.of(mesh, name)) is not None]
    every = [fitted(mesh, low, high) for low, high in permutations(sides, 2)]
    fitting = [cyclic for cyclic in every if cyclic is not None and _is_first(cyclic.axis)]
    fitting.sort(key=lambda cyclic: (-_named(cyclic.faces or ()), cyclic.faces))
    return Sector(fitting[0], False, stated is not None or _named(fitting[0].faces or ()) == 2) if fitting else None


def _is_first(axis: Sequence[float]) -> bool:
    """Return whether the largest component is positive, which selects one order of two faces."""
    return bool(axis[int(np.argmax(np.abs(axis)))] > 0.0)


def _named(faces: Sequence[str]) -> int:
    """Return the number of faces with names typical of a sector."""
    return sum(any(word in name.lower() for word in _WORDS) for name in faces)


def fitted(mesh: Mesh, low: _Face, high: _Face) -> Cyclic | None:
    """Return the disc with a sector between two faces; None if no rotation by 2 pi / N fits them.

    Local, rank 0.  With S the integral of the outward normal and c the centre, the rotation maps -S_low and c_low to S_high and
    c_high, so that both differences are normal to the axis; the angle is between -S_low and S_high, seen along the axis.
    """
    a, b, across = -low.vector, high.vector, high.centre - low.centre
    sizes = float(np.linalg.norm(a)), float(np.linalg.norm(b))
    if abs(low.area - high.area) > _ALIKE * low.area or abs(sizes[0] - sizes[1]) > _ALIKE * low.area or min(sizes) == 0.0:
        return None
    along = np.cross(b - a, across)
    if np.linalg.norm(along) <= 1e-9 * low.area * np.linalg.norm(across):
        return None
    along /= np.linalg.norm(along)
    angle = float(np.arctan2(along @ np.cross(a, b), a @ b - (a @ along) * (b @ along)))
    axis, angle = _rounded(along if angle > 0.0 else -along, 1.0), abs(angle)
    n = round(2.0 * np.pi / max(angle, 1e-9))
    if not 3 <= n <= MOST_SECTORS or abs(2.0 * np.pi / n - angle) > _ALIKE * angle or len(np.intersect1d(low.nodes, high.nodes)):
        return None
    Q = rotation(axis, 2.0 * np.pi / n)
    point = _rounded(np.linalg.lstsq(np.eye(3) - Q, high.centre - Q @ low.centre, rcond=1e-6)[0], mesh.diagonal)
    cyclic = Cyclic(sectors=n, axis=axis, axis_point=point, faces=(low.name, high.name), engine_order=1)
    return cyclic if faces_fit(mesh, cyclic) else None


def _rounded(values: np.ndarray, size: float) -> Vector:
    """Return three numbers with rounding errors of 0 removed."""
    x, y, z = (0.0 if abs(value) < 1e-6 * size else float(f"{value:.9g}") for value in values)
    return x, y, z
