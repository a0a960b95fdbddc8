"""Materials of bulk data: MAT1, MAT9 and MAT11, and their axes by PSOLID."""

from typing import Any

import numpy as np

from ...tables.structure import Material, Orientation
from ..draft import vector
from .content import Content

_FROM_MAT9 = [0, 1, 2, 3, 5, 4]  # 11, 22, 33, 12, 13, 23 among its x, y, z, xy, yz, zx


def name_of(content: Content, number: int) -> str:
    """Return the name of a material.  Local."""
    known = content.cards.materials.get(number)
    return f"{known.type if known is not None else 'MAT1'} {number}"


def materials(content: Content) -> dict[str, Material]:
    """Return the linear materials of solids; for MAT1 with Nastran's defaults among E, G and nu.  Local."""
    made = {}
    for number, card in content.cards.materials.items():
        if card.type in _KEYS:
            density = float(card.rho) * content.mass_factor
            keys = _KEYS[card.type](content, card)
            made[name_of(content, number)] = Material.of_file(density=density or None, **keys)
    return made


def _isotropic(content: Content, card: Any) -> dict[str, Any]:
    return {"young": float(card.e), "poisson": float(card.nu), "expansion": float(card.a) if card.a else None}


def _anisotropic(content: Content, card: Any) -> dict[str, Any]:
    """Return the keys of a MAT9; a thermal expansion with shear is a finding."""
    six = np.array([[getattr(card, f"G{min(i, j)}{max(i, j)}") or 0.0 for j in range(1, 7)] for i in range(1, 7)], dtype=float)
    alpha = np.array([value or 0.0 for value in (card.A if card.A is not None else ())] + [0.0] * 6, dtype=float)[:6]
    if alpha[3:].any():
        effect = "an expansion that shears the material in its own axes"
        content.left_out("MAT9", card.mid, effect, "materials")
    ordered = six[np.ix_(_FROM_MAT9, _FROM_MAT9)]
    return {"elasticity": tuple(map(tuple, ordered.tolist())), "expansion": vector(alpha[:3]) if alpha.any() else None}


def _orthotropic(content: Content, card: Any) -> dict[str, Any]:
    values = {key: tuple(float(getattr(card, name)) for name in names) for key, names in _OF_MAT11.items()}
    alpha = np.array([card.a1 or 0.0, card.a2 or 0.0, card.a3 or 0.0])
    return {**values, "expansion": vector(alpha) if alpha.any() else None}


_OF_MAT11 = {"young": ("e1", "e2", "e3"), "poisson": ("nu12", "nu13", "nu23"), "shear": ("g12", "g13", "g23")}
_KEYS = {"MAT1": _isotropic, "MAT9": _anisotropic, "MAT11": _orthotropic}


def axes_of(content: Content, solid: Any, orientations: dict[str, Orientation]) -> str | None:
    """Return the name of the material axes of a PSOLID, and add the axes; None for model axes or isotropic materials.

    Local.  CORDM is a rectangular or cylindrical system; the element system (-1) and spherical systems are findings.
    """
    material, system = content.cards.materials.get(solid.mid), int(solid.cordm or 0)
    if material is None or material.type not in ("MAT9", "MAT11") or system == 0:
        return None
    coord = content.cards.coords.get(system)
    kind = "" if coord is None else coord.type[-1]
    if kind not in ("R", "C"):
        effect = "material axes by CORDM that are neither of a rectangular nor of a cylindrical system of the file"
        content.findings.add("PSOLID CORDM", f"PSOLID {solid.pid}", effect, part="bodies")
        return None
    name = f"CORD {system}"
    i, j, k, origin = map(vector, (coord.i, coord.j, coord.k, coord.origin))
    orientations[name] = Orientation.of_file(directions=(i, j)) if kind == "R" else Orientation.of_file(axis=k, axis_point=origin)
    return name
