"""Detection of wrong units: implausible materials and lengths, and units in which they would be plausible."""

from collections.abc import Iterable, Mapping

import numpy as np

from ...tables.structure import Material
from ...tables.units import UNITS, Units

SI = "m-kg-s"
# bounds of Young's modulus (rubber to diamond), density (cork to tungsten) and size of structures
_YOUNG, _DENSITY, _SPEED, _LENGTH = (1e6, 1.3e12), (100.0, 25_000.0), (30.0, 20_000.0), (1e-4, 50.0)
_METALS = (6e10, 2.3e11)  # Pa, from aluminium to steel and nickel alloys


def suspicion(
    diagonal: float, materials: Mapping[str, Material], stated: Units, mass: float = np.nan, by_scene: bool = False
) -> str:
    """Return a text on the units suspected in place of the stated ones; empty if all values are plausible.  Local.

    Parameters
    ----------
    diagonal : diagonal of the mesh, in units of the file
    materials : materials of the file, by name; without materials only the length is checked
    mass : mass of all bodies in the stated units [kg]; NaN: unknown
    by_scene : materials of the scene, which are in SI units
    """
    odd = [text for name, material in materials.items() if (text := _odd_material(name, material, stated))]
    if odd and by_scene:
        return f"units suspected: {odd[0]}; materials of a scene are in Pa and kg/m3"
    size = diagonal * stated.length
    is_odd_size = not _within(size, _LENGTH)
    if not odd and not is_odd_size:
        return ""
    better = better_units(diagonal, materials.values()) if odd else []
    weight = "" if np.isnan(mass) else f" and weighs {mass:.4g} kg"
    symptom = (
        f"{odd[0]}, and the mesh measures {size:.4g} m across{weight}"
        if odd
        else f"the mesh measures {size:.4g} m across{weight}"
    )
    if not odd:
        return f"units suspected: {symptom}; " + (
            "if it is in millimetres, state scale = 0.001" if size > _LENGTH[1] else "state [model] scale or units"
        )
    hint = " or ".join(f'units = "{name}"' for name in better) or "state [model] units, or correct the file"
    return f"units suspected: {symptom}; {_as(diagonal, materials, better[0]) if better else ''}{hint}"


def better_units(diagonal: float, materials: Iterable[Material]) -> list[str]:
    """Return the units in which materials and length are plausible, sorted by metals and likely lengths.  Local."""
    known = [material for material in materials if material.modulus is not None or material.density is not None]
    fitting = [
        name
        for name, units in UNITS.items()
        if known
        and not any(_odd_material("", material, units) for material in known)
        and _within(diagonal * units.length, _LENGTH)
    ]
    moduli = [material.modulus for material in known if material.modulus is not None]

    def unlikely(name: str) -> tuple[int, float]:
        n_others = sum(not _within(modulus * UNITS[name].stress, _METALS) for modulus in moduli)
        return n_others, abs(np.log10(diagonal * UNITS[name].length / 0.3))

    return sorted(fitting, key=unlikely)


def _as(diagonal: float, materials: Mapping[str, Material], name: str) -> str:
    """Return length and material of the file in some units, as text."""
    units, (label, material) = UNITS[name], next(iter(materials.items()))
    parts = [f"{diagonal * units.length:.4g} m across"]
    parts += [f"young {material.modulus * units.stress:.4g} Pa"] if material.modulus is not None else []
    parts += [f"density {material.density * units.density:.4g} kg/m3"] if material.density is not None else []
    return f'in "{name}" it is {parts[0]}, {label!r} has {" and ".join(parts[1:])}: '


def _odd_material(name: str, material: Material, units: Units) -> str:
    """Return the implausible values of a material as text; empty if all are plausible."""
    young = None if material.modulus is None else material.modulus * units.stress
    density = None if material.density is None else material.density * units.density
    if young is not None and not _within(young, _YOUNG):
        return f"{name!r} has young = {young:.4g} Pa"
    if density is not None and not _within(density, _DENSITY):
        return f"{name!r} has density = {density:.4g} kg/m3"
    if young is not None and density is not None and not _within(np.sqrt(young / density), _SPEED):
        return f"{name!r} has young = {young:.4g} Pa and density = {density:.4g} kg/m3, a speed of sound that nothing has"
    return ""


def _within(value: float, limits: tuple[float, float]) -> bool:
    return limits[0] <= value <= limits[1]
