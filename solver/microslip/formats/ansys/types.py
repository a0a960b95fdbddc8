"""Element types: solids with their quadrature, and the effects of the other types."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Solid:
    """The equivalent of a solid type of Ansys in this program."""

    n_nodes: int  # 8, 20 or 10
    integration: str
    incompatible_modes: bool = True
    differs: str = ""  # remaining difference, for the notes


def solid_of(number: int, keys: dict[int, int]) -> Solid | str | None:
    """Return the equivalent of a type, the reason why there is none, or None for a type that is not a solid.  Local.

    ``keys`` are the KEYOPTs that are not 0.
    """
    if number == 185:
        if keys.get(2, 0) == 1:
            return "SOLID185 with KEYOPT(2) = 1 (not 0, 2 or 3), uniform reduced integration with hourglass control"
        if keys.get(2, 0) in (2, 3):
            return Solid(8, "full")
        differs = "SOLID185 with KEYOPT(2) = 0 integrates the volumetric strain at one point (B-bar); here at 2x2x2 points"
        return Solid(8, "full", incompatible_modes=False, differs=differs)
    if number == 186:
        return Solid(20, "full" if keys.get(2, 0) == 1 else "reduced", incompatible_modes=False)
    if number == 187:
        return Solid(10, "full")
    if number == 45:
        return Solid(8, "full", incompatible_modes=keys.get(1, 0) == 0)
    if number == 95:
        return Solid(20, "reduced" if keys.get(11, 0) == 1 else "full", differs="SOLID95 has 14 points; here 3x3x3 or 2x2x2")
    if number == 92:
        return Solid(10, "full")
    return None


EFFECTS = {  # effect of types that are neither solids nor contact surfaces here, and whether it changes the answer
    14: ("a spring and damper", True),
    39: ("a nonlinear spring", True),
    40: ("a spring, slider and gap", True),
    154: ("a surface that carries loads", False),
    169: ("a target of contact", True),
    175: ("nodes in contact", True),
    177: ("edges in contact", True),
    178: ("two nodes in contact", True),
    179: ("a bolt's pretension section; state [[statics.bolts]]", True),
    181: ("a shell", True),
    184: ("a rigid link or a joint", True),
    188: ("a beam", True),
    189: ("a beam", True),
    190: ("a solid shell", True),
    200: ("a mesh that is not solved", False),
    201: ("a follower load", False),
    281: ("a shell", True),
    285: ("a tetrahedron with pressures at its nodes", True),
}
