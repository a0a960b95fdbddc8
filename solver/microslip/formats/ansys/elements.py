"""The elements of an archive: solids as bodies, surfaces as groups of faces, others as findings."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...messages.errors import MeshError
from ...messages.words import counted
from ...tables.structure import Body, Material, Orientation
from ..model import Cells, Group
from .blocks import FIELDS, Blocks
from .contacts import CONTACT, TARGET, Side, report_contacts, side_of
from .content import Content
from .materials import orientation_of
from .shapes import faces, solids, tetrahedra

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
    if number in COUPLED:
        return _without_temperature(number, keys)
    return None


COUPLED = (225, 226, 227)  # displacements and other fields


def _without_temperature(number: int, keys: dict[int, int]) -> Solid | str:
    """Return the structural part of a solid of displacements and temperatures, or the reason why there is none.

    Integration: Ansys' theory reference, SOLID225 to 227.
    """
    if keys.get(1, 0) != 11:
        return f"SOLID{number} with KEYOPT(1) = {keys.get(1, 0)} (not 11, displacements and temperatures)"
    differs = f"SOLID{number} has temperatures too; the vibration here is isothermal"
    if number == 225:
        return Solid(8, "full", incompatible_modes=False, differs=differs)
    if number == 227:
        return Solid(10, "full", differs=differs)
    return Solid(20, "reduced" if keys.get(6, 0) == 1 else "full", incompatible_modes=False, differs=differs)


_UNKNOWN, _MISSING = "not known to this program", "which is not available here"


def cells_and_bodies(blocks: Blocks, content: Content) -> tuple[list[Cells], dict[str, Body], dict[str, Orientation]]:
    """Return the cells, the bodies (solids by material and type) and their axes, and add their groups.  Local."""
    start, flat, numbers, elements, groups = blocks.start[:-1], blocks.flat, blocks.numbers, blocks.elements, content.groups
    n_nodes = np.diff(blocks.start) - FIELDS
    material, kind, real, _, system = (flat[start + i] for i in range(5))
    for number, element_type in blocks.types.items():
        content.types.setdefault(number, element_type)
    cells: list[Cells] = []
    bodies: dict[str, Body] = {}
    orientations: dict[str, Orientation] = {}
    sides: list[Side] = []
    others: dict[tuple[int, str | None], tuple[int, list[int]]] = {}  # elements and ETs of a type, and why it is no solid here
    for number in np.unique(kind):
        type_number = content.types.get(int(number), 0)
        solid = solid_of(type_number, content.keys.get(int(number), {}))
        rows_of_type = kind == number
        if not isinstance(solid, Solid):
            if type_number not in (*CONTACT, TARGET):
                n, of_types = others.get((type_number, solid), (0, []))
                others[type_number, solid] = (n + int(rows_of_type.sum()), [*of_types, int(number)])
            for value in np.unique(real[rows_of_type]) if type_number in (154, *CONTACT, TARGET) else ():
                members = rows_of_type & (real == value)
                rows = _rows(flat, start, n_nodes, members, 8)
                if type_number == 154:
                    _add_cells(groups, f"SURF154 real {value}", cells, faces(rows, elements[members], numbers))
                else:
                    of_material = int(material[members][0])
                    sides.append(side_of(type_number, int(number), int(value), of_material, rows, elements[members], numbers))
                    _add_cells(groups, sides[-1].group, cells, list(sides[-1].cells))
            continue
        if type_number == 185 and content.is_chosen and 2 not in content.keys.get(int(number), {}):
            effect = "KEYOPT(2) is left to Ansys by ETCONTROL; state it, 2 or 3 for enhanced strains"
            content.findings.add("SOLID185", f"ET {number}", effect)
        elif solid.differs:
            content.findings.add(f"SOLID{type_number}", f"ET {number}", solid.differs, False, is_taken=True)
        for value in np.unique(material[rows_of_type]):
            of_material = rows_of_type & (material == value)
            named = f"material {value}" if (kind[material == value] == number).all() else f"material {value} type {number}"
            for name, members, axes in _by_axes(named, of_material, system, content, int(value), orientations):
                rows = _rows(flat, start, n_nodes, members, solid.n_nodes)
                _add_cells(groups, name, cells, (tetrahedra if solid.n_nodes == 10 else solids)(rows, elements[members], numbers))
                bodies[name] = Body.of_file(
                    group=name,
                    material=f"material {value}",
                    orientation=axes,
                    integration=solid.integration,
                    incompatible_modes=solid.incompatible_modes,
                )
    for (type_number, why), (n, of_types) in others.items():
        _report_type(content, of_types, type_number, why, n)
    report_contacts(content, sides)
    _refuse_without_solids(content, kind)
    return cells, bodies, orientations


def _refuse_without_solids(content: Content, kind: np.ndarray) -> None:
    """Raise MeshError if no element is a solid that is available, and some types are not; ``kind`` (n,): numbers of the types."""
    numbers, counts = np.unique(kind, return_counts=True)
    n_of: dict[tuple[int, str], int] = {}
    for number, n in zip(numbers.tolist(), counts.tolist(), strict=True):
        element = content.types.get(number, 0)
        solid = solid_of(element, content.keys.get(number, {}))
        if isinstance(solid, Solid):
            return
        effect = EFFECTS.get(element, (_UNKNOWN,))[0] if solid is None else f"{solid}, {_MISSING}"
        n_of[element, effect] = n_of.get((element, effect), 0) + n
    if not {element for element, _ in n_of} - {*EFFECTS, *CONTACT, TARGET, 21}:
        return  # known types have findings with their effects
    types = [f"{n} of type {element}, {effect}" for (element, effect), n in n_of.items()]
    raise MeshError(f"none of its elements are solids that this program has: {'; '.join(types)}")


def _by_axes(
    name: str, members: np.ndarray, system: np.ndarray, content: Content, material: int, orientations: dict[str, Orientation]
) -> Iterator[tuple[str, np.ndarray, str | None]]:
    """Yield the elements of one material with the same axes, a name for them, and the name of the axes.

    Elements of isotropic materials stay together. Axes other than the model's are added to ``orientations``.
    """
    if not content.materials.get(material, Material.of_file()).has_axes:
        yield name, members, None
        return
    alike = np.unique(system[members])
    for number in alike:
        axes = f"ESYS {number}" if number else None
        if axes is not None:
            made = orientation_of(*content.systems[int(number)]) if int(number) in content.systems else None
            if made is None:
                effect = f"element axes of material {material}, which no LOCAL states as Cartesian or cylindrical"
                content.findings.add(axes, f"{counted((members & (system == number)).sum(), 'element')}", effect, part="bodies")
                axes = None
            else:
                orientations[axes] = made
        yield (name if len(alike) == 1 else f"{name} ESYS {number}"), members & (system == number), axes


def _rows(flat: np.ndarray, start: np.ndarray, n_nodes: np.ndarray, members: np.ndarray, width: int) -> np.ndarray:
    """Return the nodes of some elements, (n, width), padded with 0."""
    at = start[members][:, None] + FIELDS + np.arange(width)
    exists = np.arange(width) < n_nodes[members][:, None]
    return np.where(exists, flat[np.minimum(at, len(flat) - 1)], 0)


def _add_cells(groups: dict[str, Group], name: str, cells: list[Cells], made: list[Cells]) -> None:
    for block in made:
        cells.append(block)
        groups.setdefault(name, Group()).add_cells(len(cells) - 1, np.arange(len(block.nodes)))


def _report_type(content: Content, of_types: list[int], type_number: int, why: str | None, n: int) -> None:
    """Report elements that are not solids here; ``of_types``: the numbers of their ETs."""
    if type_number in (14, 21):
        return  # springs and masses: attached.py
    effect, changes = EFFECTS.get(type_number, (_UNKNOWN, True))
    if why is not None:
        effect, changes = f"{why}, {_MISSING}", True
    word = f"element type {type_number}" if type_number else "element without ET"
    named = ", ".join(map(str, of_types[:3])) + (", …" if len(of_types) > 3 else "")
    content.findings.add(word, f"{counted(n, 'element')} of ET {named}", effect, changes)
