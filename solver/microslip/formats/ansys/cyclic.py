"""CYCLIC of Ansys and its components: the sector of a file, and the keys of [cyclic] that a scene needs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from ...messages.errors import MeshError
from ...tables.table import Vector
from ..draft import vector
from ..model import FileSectors, Group, sectors_in_words
from .commands import Command
from .constraints import turned_axes

if TYPE_CHECKING:
    from .content import Content

LOW, HIGH = "_M01L", "_M01H"  # endings of CYCLIC's components for the two edges of a sector
_NOTHING = ("OFF", "STAT", "UNDO")  # CYCLIC,OFF and listings
_AXES = {0: 2, 1: 2, 5: 1, 6: 0}  # axis of the global cylindrical systems: z, y, x


def sectors_of(content: Content, commands: Iterable[Command]) -> FileSectors | None:
    """Return the sector of a file, with a finding if CYCLIC states it; None without a sector.  Local."""
    faces = _faces(content.groups)
    stated = [command for command in commands if command.word == "CYCLIC" and command.field(0)[:4].upper() not in _NOTHING]
    if not stated:
        return None if faces is None else FileSectors(faces=faces)
    command = stated[-1]
    count, angle, system = (_number(command, i) for i in range(3))
    n = int(count) or (round(360.0 / angle) if angle > 0.0 else None)
    axis, point = _axis(content, int(system))
    sectors = FileSectors(sectors=n, axis=axis, axis_point=point, faces=faces)
    content.findings.add("CYCLIC", command.where, f"cyclic symmetry; {sectors_in_words(sectors)}", part="cyclic")
    return sectors


def _number(command: Command, i: int) -> float:
    """Return a field as a number; 0 if it is empty or a parameter, which is not evaluated."""
    try:
        return command.number(i)
    except MeshError:
        return 0.0


def _faces(groups: Mapping[str, Group]) -> tuple[str, str] | None:
    """Return the components of the low and the high edge; the high edge has the greater angle."""
    by_word = {name.upper(): name for name in groups}
    lows = [name for name in by_word if name.endswith(LOW) and name.removesuffix(LOW) + HIGH in by_word]
    return (by_word[lows[0]], by_word[lows[0].removesuffix(LOW) + HIGH]) if lows else None


def _axis(content: Content, number: int) -> tuple[Vector | None, Vector | None]:
    """Return the axis of a cylindrical system and a point on it, by the number of the system."""
    if number in _AXES:
        return vector(np.eye(3)[_AXES[number]]), (0.0, 0.0, 0.0)
    if number not in content.systems:
        return None, None
    _, origin, angles = content.systems[number]
    return vector(turned_axes(angles)[2]), vector(origin)
