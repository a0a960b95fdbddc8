"""Materials of an archive by the labels of MP and MPDATA: isotropic, or orthotropic along element axes (ESYS)."""

from collections.abc import Mapping

import numpy as np

from ...tables.structure import Material, Orientation
from ...tables.table import Vector
from ..draft import vector
from .commands import Command
from .constraints import turned_axes

PLAIN = ("EX", "NUXY", "PRXY", "DENS", "ALPX")  # labels of an isotropic material
_ALIKE = 1e-4  # relative difference of a property repeated for other axes: rounding
_PAIRS = ("XY", "XZ", "YZ")
OTHER_AXES = ("EY", "EZ", "NUYZ", "NUXZ", "PRYZ", "PRXZ", "GXY", "GXZ", "GYZ", "ALPY", "ALPZ")


def material_of(known: Mapping[str, float]) -> tuple[Material, tuple[str, ...]]:
    """Return a material, and the labels of an incomplete anisotropy.  Local."""
    young, poisson = known.get("EX"), known.get("PRXY", known.get("NUXY"))
    plain = Material.of_file(young=young, poisson=poisson, density=known.get("DENS"), expansion=known.get("ALPX"))
    other = _labels_that_differ(known, plain)
    if not other:
        return plain, ()
    expansion = tuple(known.get(f"ALP{axis}", 0.0) for axis in "XYZ") if any(label.startswith("ALP") for label in other) else None
    if expansion is not None:
        plain = plain.with_keys(expansion=expansion)
        other = tuple(label for label in other if not label.startswith("ALP"))
    if not other:
        return plain.with_axes(), ()
    constants = _constants(known)
    return (plain, other) if constants is None else (plain.with_keys(**constants), ())


def _labels_that_differ(known: Mapping[str, float], plain: Material) -> tuple[str, ...]:
    """Return the labels of other axes with values that contradict an isotropic material."""
    young, poisson = plain.young, plain.poisson
    shear = (
        young / (2.0 * (1.0 + poisson)) if isinstance(young, float) and isinstance(poisson, float) and poisson != -1.0 else None
    )
    expected = {"E": young, "NU": poisson, "PR": poisson, "G": shear, "ALP": plain.expansion}
    labels = []
    for label in OTHER_AXES:
        same = expected[label.rstrip("XYZ")]
        if label in known and (not isinstance(same, float) or abs(known[label] - same) > _ALIKE * abs(same)):
            labels.append(label)
    return tuple(labels)


def _constants(known: Mapping[str, float]) -> dict[str, Vector] | None:
    """Return the nine constants of an orthotropic material as keys of a ``Material``; None if one is missing.

    PRij is the major ratio nu_ij, NUij the minor ratio nu_ji = nu_ij E_j / E_i.
    """
    young = [known.get(f"E{axis}", 0.0) for axis in "XYZ"]
    shear = [known.get(f"G{pair}", 0.0) for pair in _PAIRS]
    if not all(young) or not all(shear):
        return None
    poisson = []
    for pair in _PAIRS:
        i, j = ("XYZ".index(axis) for axis in pair)
        if f"PR{pair}" in known:
            poisson.append(known[f"PR{pair}"])
        elif f"NU{pair}" in known:
            poisson.append(known[f"NU{pair}"] * young[i] / young[j])
        else:
            return None
    return {"young": vector(young), "poisson": vector(poisson), "shear": vector(shear)}


def take_system(systems: dict[int, tuple[int, np.ndarray, np.ndarray]], command: Command) -> None:
    """Take a LOCAL command: kind, origin and angles of a coordinate system, as CDWRITE writes it, or in one line.  Local."""
    first = 2 if command.is_archived else 0
    number, kind = int(command.number(first)), int(command.number(first + 1))
    values = np.array([command.number(first + 2 + i) for i in range(6)])
    _, origin, angles = systems.get(number, (kind, np.zeros(3), np.zeros(3)))
    part = command.field(1).upper() if command.is_archived else ""
    if part in ("", "LOC"):
        origin = values[:3]
    if part in ("", "ANG"):
        angles = values[:3] if part else values[3:]
    systems[number] = kind, origin, angles


def orientation_of(kind: int, origin: np.ndarray, angles: np.ndarray) -> Orientation | None:
    """Return the axes of a Cartesian (0) or cylindrical (1) system, whose z is the axis; None for others.  Local."""
    x, y, z = turned_axes(angles)
    if kind == 0:
        return Orientation.of_file(directions=(vector(x), vector(y)))
    return Orientation.of_file(axis=vector(z), axis_point=vector(origin)) if kind == 1 else None
