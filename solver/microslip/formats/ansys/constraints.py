"""What an archive says of displacements: D, CE, CP and CERIG, and nodal axes that are turned."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...messages.errors import MeshError
from ...tables.structure import Support
from ..model import Equations, Finding, Group, held_alike, index_of
from .commands import Command

_AXES = {"UX": 0, "UY": 1, "UZ": 2}
_TURNS = {"ROTX": 3, "ROTY": 4, "ROTZ": 5}  # of nodes that lead rigid regions; those of solids have none
_NAMES = ("x", "y", "z", "rx", "ry", "rz")


@dataclass
class Restraints:
    """What has been gathered so far; nodes are numbers of the file."""

    held: dict[int, set[int]] = field(default_factory=dict)  # axis, 0 to 5: nodes
    equations: list[tuple[str, list[tuple[int, int, float]]]] = field(default_factory=list)  # where, terms
    coupled: dict[str, tuple[str, str, list[int]]] = field(default_factory=dict)  # set: where, label, nodes
    rigid: list[tuple[str, int, list[int]]] = field(default_factory=list)  # where, leading node, those that follow
    findings: list[Finding] = field(default_factory=list)
    is_open: bool = False  # lines with terms of the last equation may follow
    typed: dict[str, list[tuple[int, int, float]]] = field(default_factory=dict)  # number of a CE as it is typed: its terms

    def left_out(self, command: Command, effect: str, part: str = "") -> None:
        self.findings.append(Finding(word=command.word, where=command.where, effect=effect, changes=True, part=part))


def take_support(found: Restraints, command: Command, selected: np.ndarray | None, components: dict[str, np.ndarray]) -> None:
    """Take a D command: a node, a range of them, ALL or a component; a label or ALL; a value that must be 0."""
    nodes, label = _nodes(command.field(0), selected, components), command.field(1).upper()
    if nodes is None:
        found.left_out(
            command, f"a support of {command.field(0)!r}, which is no node, component or selection known here", "supports"
        )
        return
    if command.field(4) and len(nodes) == 1:
        nodes = np.arange(nodes[0], int(command.number(4)) + 1, max(int(command.number(5)), 1))
    labels = [*_AXES, *_TURNS] if label in ("ALL", "") else [label, *(one.upper() for one in command.fields[6:11] if one)]
    value = command.field(2)
    if value and command.number(2) != 0.0:
        found.left_out(command, f"a displacement {label} = {value} other than 0", "supports")
        return
    for one in labels:
        if one in _AXES or one in _TURNS:
            found.held.setdefault({**_AXES, **_TURNS}[one], set()).update(nodes.tolist())
        else:
            found.left_out(command, f"a support of {one}, which is no displacement", "supports")


def take_equation(found: Restraints, command: Command) -> None:
    """Take a CE command, as typed or as CDWRITE writes it: DEFI, then NODE with up to two terms a line."""
    if command.field(0).upper().startswith("R5"):
        _take_written(found, command)
        return
    if command.number(1) != 0.0:
        found.left_out(command, "an equation whose constant is not 0", "equations")
    else:
        _add_equation(found, command, command.where, command.fields[2:])


def _take_written(found: Restraints, command: Command) -> None:
    if command.field(1).upper() == "DEFI":
        if command.number(4) != 0.0:
            found.left_out(command, "an equation whose constant is not 0", "equations")
            found.is_open = False
        else:
            found.equations.append((f"{command.word}, {command.where}", []))
            found.is_open = True
    elif found.is_open:
        found.is_open = _extend(found, command, found.equations[-1][1], command.fields[2:])


def _add_equation(found: Restraints, command: Command, where: str, fields: tuple[str, ...]) -> None:
    """Take an equation as it is typed; a further command with its number adds terms."""
    number = command.field(0).upper()
    is_further = number.isdigit() and number in found.typed
    terms = found.typed[number] if is_further else []
    if number.isdigit():
        found.typed[number] = terms
    if not is_further:
        found.equations.append((f"{command.word}, {where}", terms))
        _extend(found, command, terms, fields)
    elif terms:  # none: it has been left out
        _extend(found, command, terms, fields)


def _extend(found: Restraints, command: Command, terms: list[tuple[int, int, float]], fields: tuple[str, ...]) -> bool:
    """Add the terms of fields (node, label, coefficient); report what is no displacement, and leave no terms then."""
    own = Command(command.word, fields, command.line)
    for i in range(0, len(fields) - 2, 3):
        if not fields[i]:
            break
        label = fields[i + 1].upper()
        if label not in _AXES:
            found.left_out(command, f"an equation with {label}, which is no displacement", "equations")
            terms.clear()
            return False
        terms.append((int(own.number(i)), _AXES[label], own.number(i + 2)))
    return True


def take_coupling(found: Restraints, command: Command) -> None:
    """Take a CP command as it is typed: a set, a label, nodes."""
    if command.field(0).upper().startswith("R5"):
        found.left_out(
            command, "coupled nodes as CDWRITE writes them, which is not documented; write them as CE (CPTOCE)", "equations"
        )
        return
    label = command.field(1).upper()
    if label not in (*_AXES, "ALL"):
        found.left_out(command, f"coupled nodes in {label}, which is no displacement", "equations")
        return
    _, _, nodes = found.coupled.setdefault(command.field(0), (command.where, label, []))
    nodes.extend(int(Command(command.word, (word,), command.line).number(0)) for word in command.fields[2:] if word)


def take_rigid(found: Restraints, command: Command, selected: np.ndarray | None, components: dict[str, np.ndarray]) -> None:
    """Take a CERIG command: nodes that follow one as a rigid body, in all directions."""
    label = command.field(2).upper()
    followers = _nodes(command.field(1), selected, components)
    if label not in ("", "ALL", "UXYZ") or followers is None:
        found.left_out(command, f"a rigid region of {command.field(1)!r} in {label or 'ALL'}", "points")
        return
    found.rigid.append((command.where, int(command.number(0)), [int(node) for node in followers]))


def _nodes(word: str, selected: np.ndarray | None, components: dict[str, np.ndarray]) -> np.ndarray | None:
    if word.upper() == "ALL":
        return selected
    if word.upper() in components:
        return components[word.upper()]
    try:
        return np.array([int(float(word))])
    except ValueError:
        return None


def supports(
    found: Restraints, numbers: np.ndarray, angles: np.ndarray, groups: dict[str, Group], leaders: dict[int, str]
) -> tuple[Support, ...]:
    """Return supports by groups "D x", "D xy", ... of the nodes that they hold; those in turned axes become equations.  Local.

    ``leaders`` names the points that nodes of the file lead, which have rotations, too.
    """
    held = np.zeros((len(numbers), 6), dtype=bool)
    for axis, nodes in found.held.items():
        index, missing = index_of(numbers, np.array(sorted(nodes), dtype=np.int64))
        held[index[~np.isin(sorted(nodes), missing)], axis] = True
    made = _of_leaders(found, held, numbers, angles, leaders)
    held = held[:, :3]
    is_turned = angles.any(axis=1) & held.any(axis=1) & ~held.all(axis=1)
    for i in np.flatnonzero(is_turned):
        rows = turned_axes(angles[i])
        for axis in np.flatnonzero(held[i]):
            terms = [(int(numbers[i]), k, float(rows[axis, k])) for k in range(3)]
            found.equations.append((f"D, node {numbers[i]} in turned axes", terms))
    held[is_turned] = False
    for axes, alike in held_alike(held):
        fix = tuple(_NAMES[axis] for axis in axes)
        name = f"D {''.join(fix)}"
        groups.setdefault(name, Group()).add_nodes(alike)
        made.append(Support.of_file(group=name, fix=fix))
    return tuple(made)


def _of_leaders(
    found: Restraints, held: np.ndarray, numbers: np.ndarray, angles: np.ndarray, leaders: dict[int, str]
) -> list[Support]:
    """Return the supports of points, and take them out of ``held`` (n_nodes, 6)."""
    made = []
    for i in np.flatnonzero(np.isin(numbers, list(leaders)) & held.any(axis=1)):
        fix = tuple(_NAMES[axis] for axis in np.flatnonzero(held[i]))
        parts = held[i, :3], held[i, 3:]
        if angles[i].any() and any(part.any() and not part.all() for part in parts):
            effect = "a support in turned axes of a node that leads a rigid region"
            where = f"node {numbers[i]}"
            found.findings.append(Finding(word="D", where=where, effect=effect, changes=True, part="supports"))
        else:
            made.append(Support.of_file(point=leaders[int(numbers[i])], fix=fix))
        held[i] = False
    return made


def turned_axes(angles: np.ndarray) -> np.ndarray:
    """Return the nodal axes, (3, 3) rows, of the angles THXY, THYZ, THZX in degrees: about z, then x, then y.  Local."""
    z, x, y = np.radians(angles)
    about_z = np.array([[np.cos(z), np.sin(z), 0.0], [-np.sin(z), np.cos(z), 0.0], [0.0, 0.0, 1.0]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(x), np.sin(x)], [0.0, -np.sin(x), np.cos(x)]])
    about_y = np.array([[np.cos(y), 0.0, -np.sin(y)], [0.0, 1.0, 0.0], [np.sin(y), 0.0, np.cos(y)]])
    return about_y @ about_x @ about_z


def _is_of_leader(found: Restraints, where: str, terms: list[tuple[int, int, float]], leaders: set[int]) -> bool:
    """Return whether an equation holds a node that leads a rigid region, with a finding."""
    own = [node for node, _, _ in terms if node in leaders]
    if own:
        word, _, place = where.partition(", ")
        effect = f"an equation of node {own[0]}, which leads a rigid region"
        found.findings.append(Finding(word=word, where=place, effect=effect, changes=True, part="equations"))
    return bool(own)


def equations(found: Restraints, numbers: np.ndarray, angles: np.ndarray, leaders: set[int]) -> Equations | None:
    """Return the equations and couplings in model axes, None without any.  Local.

    Raises
    ------
    MeshError : a node that is not there
    """
    rows = list(found.equations)
    for where, label, followers in found.coupled.values():
        for axis in range(3) if label == "ALL" else [_AXES[label]] if label in _AXES else []:
            rows += [(f"CP, {where}", [(node, axis, 1.0), (followers[0], axis, -1.0)]) for node in followers[1:]]
    rows = [row for row in rows if row[1] and not _is_of_leader(found, *row, leaders)]
    if not rows:
        return None
    terms = [(i, *term) for i, (_, own) in enumerate(rows) for term in own]
    equation, nodes, axes, values = (np.array(column) for column in zip(*terms, strict=True))
    index, missing = index_of(numbers, nodes)
    if len(missing):
        where = rows[int(equation[np.argmax(nodes == missing[0])])][0]
        raise MeshError(f"{where}: there is no node {missing[0]}")
    parts = [(equation, index, axes, values)]
    is_turned = angles[index].any(axis=1) & np.array([not where.startswith("D, ") for where, _ in rows])[equation]
    if is_turned.any():
        stays = ~is_turned
        parts = [(equation[stays], index[stays], axes[stays], values[stays])]
        for i in np.flatnonzero(is_turned):
            row = turned_axes(angles[index[i]])[axes[i]]
            parts.append((np.full(3, equation[i]), np.full(3, index[i]), np.arange(3), values[i] * row))
    equation, index, axes, values = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(equation, kind="stable")
    places = tuple(place for place, _ in rows)
    is_support = np.array([one.startswith("D, ") for one in places], dtype=bool)
    return Equations(equation[order], index[order], axes[order], values[order].astype(float), places, is_support)
