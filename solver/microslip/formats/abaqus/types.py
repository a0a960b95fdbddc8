"""Element types of Abaqus and CalculiX: their cells, the quadrature of solids, the effects of other types."""

import re
from dataclasses import dataclass

_SOLIDS = {4: "tet4", 10: "tet10", 8: "hex8", 20: "hex20", 6: "wedge6", 15: "wedge15", 5: "pyramid5", 27: "hex27"}
_SHELLS = {3: "tri3", 6: "tri6", 4: "quad4", 8: "quad8", 65: "tri6", 9: "quad9"}
_LINES = {"T2D2": "line2", "T2D3": "line3", "T3D2": "line2", "T3D3": "line3", "B31": "line2", "B32": "line3"}
# suffix: R reduced, I incompatible modes, H hybrid, M modified, S and V variants of these
_VARIANT = r"(R|I|RI|IH|H|RH|M|MH|HS|S|V|VH)?"

# masses, springs and dampers, and the card of their properties
OF_DISCRETE = {"MASS": "MASS", "ROTARYI": "ROTARY INERTIA"} | {
    f"{word}{kind}": word for word in ("SPRING", "DASHPOT") for kind in ("1", "2", "A")
}


@dataclass(frozen=True)
class Integration:
    """The quadrature of a body's elements in terms of ``Body``."""

    integration: str
    incompatible_modes: bool


def kind_of(word: str) -> str | None:
    """Return the kind of cell of an element type; None for types without cells (springs, masses, ...)."""
    solid = re.fullmatch(r"C3D(\d+)[A-Z]*", word)
    shell = re.match(r"(?:CPS|CPE|CAX|M3D|SFM3D|R3D|STRI|S|DS)(\d+)", word)
    if solid:
        return _SOLIDS.get(int(solid[1]), f"{word}, which this program does not have")
    if shell:
        return _SHELLS.get(int(shell[1]))
    return _LINES.get(word.rstrip("RHI"))


def is_solid(word: str) -> bool:
    """Return whether the name of an element type is that of a solid.  Local."""
    return word.startswith("C3D")


def integration_of(word: str) -> Integration | None:
    """Return the quadrature of a solid type; None for unknown variants."""
    match = re.fullmatch(r"C3D(\d+)" + _VARIANT, word)
    if not match or int(match[1]) not in _SOLIDS:
        return None
    n_nodes, variant = int(match[1]), match[2] or ""
    if n_nodes == 8:
        return Integration("full", "I" in variant or "R" in variant)
    if n_nodes == 20:
        return Integration("reduced-both" if "R" in variant else "full", True)
    return Integration("reduced-both" if n_nodes in (4, 6, 10, 15) else "full", True)


def note_on(word: str) -> str:
    """Return the substitution made for a solid type as text; "" without substitution."""
    if word in ("C3D8R", "C3D8RH"):
        return "one integration point with hourglass control is not available: they are taken as C3D8I, incompatible modes"
    if re.fullmatch(r"C3D10(M|MH|HS|I)", word):
        return "they are taken as C3D10"
    if re.fullmatch(r"C3D\d+\w*H", word):
        return "pressure is not a separate unknown: near incompressibility they are stiffer here"
    return ""
