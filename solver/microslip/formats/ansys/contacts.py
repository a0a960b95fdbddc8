"""Contact elements of a file: the two surfaces of each pair as groups, and the kind of contact."""

from dataclasses import dataclass

import numpy as np

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
    n: int
    cells: tuple[Cells, ...]  # its faces; empty for pilot nodes and rigid primitives

    @property
    def group(self) -> str:
        """The name of the group of its faces."""
        return f"{'TARGE' if self.kind == TARGET else 'CONTA'}{self.kind} real {self.real}"


def side_of(kind: int, number: int, real: int, rows: np.ndarray, elements: np.ndarray, numbers: np.ndarray) -> Side:
    """Return one side of a contact with its faces.  Local.

    Parameters
    ----------
    kind, number, real : element, number of its type, set of real constants
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
    return Side(kind, number, real, len(rows), tuple(made))


def _as_quads(rows: np.ndarray, n_nodes: np.ndarray) -> np.ndarray:
    """Return rows of triangles of 3 or 6 nodes as rows of collapsed quadrilaterals."""
    quads = rows.copy()
    three, six = n_nodes == 3, n_nodes == 6
    quads[three, 3] = rows[three, 2]
    quads[six] = rows[six][:, [0, 1, 2, 2, 3, 4, 2, 5]]
    return quads


def report_contacts(content: Content, sides: list[Side]) -> None:
    """Add a finding for each side of each pair; a joint or a tie between the two groups resolves it.  Local."""
    for side in sides:
        partners = [other for other in sides if other.real == side.real and (other.kind == TARGET) != (side.kind == TARGET)]
        touching = side if side.kind != TARGET else partners[0] if partners else None
        behaviour = 0 if touching is None else content.keys.get(touching.type, {}).get(12, 0)
        is_pair = len(partners) == 1 and bool(side.cells) and bool(partners[0].cells)
        names = () if not is_pair else (partners[0].group, side.group) if side.kind == TARGET else (side.group, partners[0].group)
        content.findings.take(
            Finding(
                word=f"element type {side.kind}",
                where=f"{side.n} elements of ET {side.type}",
                effect=_effect(side, behaviour, names),
                changes=True,
                surfaces=names,
                is_glued=is_pair and behaviour in _BONDED,
            )
        )


def _effect(side: Side, behaviour: int, names: tuple[str, ...]) -> str:
    """Return the effect of a side and its replacement in a scene, as text."""
    what = "a target of contact" if side.kind == TARGET else "a surface in contact"
    if not names:
        return what if side.cells else f"{what} without faces: a pilot node or a rigid body; state [[points]]"
    table = "[[ties]] or [[joints]]" if behaviour in _BONDED else "[[joints]]"
    return f'{what}, {_BEHAVIOUR.get(behaviour, "of another kind")}; state {table} with surfaces = ["{names[0]}", "{names[1]}"]'
