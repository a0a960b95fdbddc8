"""Contact elements of a file: the two surfaces of each pair as groups, and the kind of contact."""

from dataclasses import dataclass

import numpy as np

from ...messages.words import counted
from ...tables.joint import Joint
from ..model import Cells, Finding
from .content import Content
from .shapes import faces

CONTACT, TARGET = (173, 174), 170  # surface elements; a pair has one set of real constants
_BEHAVIOUR = {  # KEYOPT(12) of the contact side
    0: "with friction",
    1: "rough",
    2: "without separation",
    3: "bonded",
    4: "without separation",
    5: "bonded",
    6: "bonded where it touches at first",
}
_BONDED = (3, 5, 6)


@dataclass(frozen=True)
class Side:
    """The elements of one type and one set of real constants."""

    kind: int  # element type: 170, 173 or 174
    type: int  # number of the type in the file
    real: int
    material: int
    n: int
    cells: tuple[Cells, ...]  # its faces; empty for pilot nodes and rigid primitives
    pilot: int = 0  # number of the node that alone is the target; 0: none

    @property
    def group(self) -> str:
        """The name of the group of its faces."""
        return f"{'TARGE' if self.kind == TARGET else 'CONTA'}{self.kind} real {self.real}"


def side_of(
    kind: int, number: int, real: int, material: int, rows: np.ndarray, elements: np.ndarray, numbers: np.ndarray
) -> Side:
    """Return one side of a contact with its faces.  Local.

    Parameters
    ----------
    kind, number, real, material : element, number of its type, set of real constants, number of its material
    rows : (n, 8) node numbers, padded with 0
    elements : (n,) element numbers
    numbers : (n_points,) node numbers of the file

    Raises
    ------
    MeshError : a node that does not exist
    """
    n_nodes = (rows > 0).sum(axis=1)
    is_face = n_nodes >= 3
    made = faces(_as_quads(rows[is_face], n_nodes[is_face]), elements[is_face], numbers) if is_face.any() else []
    pilot = int(rows[0, 0]) if kind == TARGET and len(rows) == 1 and n_nodes[0] == 1 else 0
    return Side(kind, number, real, material, len(rows), tuple(made), pilot)


def _as_quads(rows: np.ndarray, n_nodes: np.ndarray) -> np.ndarray:
    """Return rows of triangles of 3 or 6 nodes as rows of collapsed quadrilaterals."""
    quads = rows.copy()
    three, six = n_nodes == 3, n_nodes == 6
    quads[three, 3] = rows[three, 2]
    quads[six] = rows[six][:, [0, 1, 2, 2, 3, 4, 2, 5]]
    return quads


def report_contacts(content: Content, sides: list[Side]) -> None:
    """Add a finding for each side of each pair; a joint or a tie between the two groups resolves it.

    Local.  A pair with friction is also a joint of the file, with the friction coefficient of the contact side's material.
    """
    for side in sides:
        partners = [other for other in sides if other.real == side.real and (other.kind == TARGET) != (side.kind == TARGET)]
        touching = side if side.kind != TARGET else partners[0] if partners else None
        if len(partners) == 1 and touching is not None and _take_pilot(content, side, partners[0], touching):
            continue
        behaviour = 0 if touching is None else content.keys.get(touching.type, {}).get(12, 0)
        is_pair = len(partners) == 1 and bool(side.cells) and bool(partners[0].cells)
        names = () if not is_pair else (partners[0].group, side.group) if side.kind == TARGET else (side.group, partners[0].group)
        if is_pair and touching is side and behaviour == 0 and side.material in content.friction:
            friction = content.friction[side.material]
            content.joints.append(Joint.of_file(name=f"contact_real_{side.real}", surfaces=names, friction=friction))
        content.findings.take(
            Finding(
                word=f"element type {side.kind}",
                where=f"{counted(side.n, 'element')} of ET {side.type}",
                effect=_effect(side, behaviour, names),
                changes=True,
                surfaces=names,
                is_glued=is_pair and behaviour in _BONDED,
            )
        )


def _take_pilot(content: Content, side: Side, partner: Side, touching: Side) -> bool:
    """Take a surface that a pilot node leads by equations as a point, from its contact side; return whether it is one."""
    keys, pilot = content.keys.get(touching.type, {}), side.pilot or partner.pilot
    connection = {1: "distributing", 2: "rigid"}.get(keys.get(4, 0))
    if not pilot or not touching.cells or keys.get(2, 0) != 2 or keys.get(12, 0) not in _BONDED or connection is None:
        return False
    if side is touching:
        content.pilots.append((pilot, np.unique(np.concatenate([cells.nodes.ravel() for cells in side.cells])), connection))
    return True


def _effect(side: Side, behaviour: int, names: tuple[str, ...]) -> str:
    """Return the effect of a side and its replacement in a scene, as text."""
    what = "a target of contact" if side.kind == TARGET else "a surface in contact"
    if not names:
        return what if side.cells else f"{what} without faces: a pilot node or a rigid body; state [[points]]"
    table = "[[ties]] or [[joints]]" if behaviour in _BONDED else "[[joints]]"
    return f'{what}, {_BEHAVIOUR.get(behaviour, "of another kind")}; state {table} with surfaces = ["{names[0]}", "{names[1]}"]'
