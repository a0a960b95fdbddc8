"""Constraints of displacements in an archive: D, CE, CP and CERIG, and rotated nodal axes."""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from ..draft import Draft, Findings, Term
from ..model import index_of
from .commands import Command

_AXES = {"UX": 0, "UY": 1, "UZ": 2}
_TURNS = {"ROTX": 3, "ROTY": 4, "ROTZ": 5}  # rotations of leading nodes of rigid regions; nodes of solids have none
_DIRECTIONS = _AXES | _TURNS


@dataclass
class Restraints:
    """The constraints so far; nodes are numbers of the file."""

    fixed: dict[int, set[int]] = field(default_factory=dict)  # axis, 0 to 5: nodes
    equations: list[tuple[str, list[Term]]] = field(default_factory=list)  # where, terms
    coupled: dict[str, tuple[str, str, list[int]]] = field(default_factory=dict)  # set: where, label, nodes
    rigid: list[tuple[str, int, list[int]]] = field(default_factory=list)  # where, leading node, following nodes
    findings: Findings = field(default_factory=Findings)
    is_open: bool = False  # whether lines with terms of the last equation may follow
    typed: dict[str, list[Term]] = field(default_factory=dict)  # number of a typed CE: its terms

    def left_out(self, command: Command, effect: str, part: str = "") -> None:
        """Add a finding on a command that is not taken over.  Local."""
        self.findings.add(command.word, command.where, effect, part=part)


def take_support(
    restraints: Restraints, command: Command, selected: np.ndarray | None, components: dict[str, np.ndarray]
) -> None:
    """Take a D command: a node, a range of nodes, ALL or a component; a label or ALL; a value that must be 0."""
    nodes, label = _nodes(command.field(0), selected, components), command.field(1).upper()
    if nodes is None:
        restraints.left_out(
            command, f"a support of {command.field(0)!r}, which is not a known node, component or selection", "supports"
        )
        return
    if command.field(4) and len(nodes) == 1:
        nodes = np.arange(nodes[0], int(command.number(4)) + 1, max(int(command.number(5)), 1))
    labels = [*_AXES, *_TURNS] if label in ("ALL", "") else [label, *(axis.upper() for axis in command.fields[6:11] if axis)]
    value = command.field(2)
    if value and command.number(2) != 0.0:
        restraints.left_out(command, f"a displacement {label} = {value} other than 0", "supports")
        return
    for axis in labels:
        if axis in _DIRECTIONS:
            restraints.fixed.setdefault(_DIRECTIONS[axis], set()).update(nodes.tolist())
        else:
            restraints.left_out(command, f"a support of {axis}, which is not a displacement", "supports")


def take_equation(restraints: Restraints, command: Command) -> None:
    """Take a CE command, as typed or as CDWRITE writes it: DEFI, then NODE with up to two terms per line."""
    if command.is_archived:
        _take_written(restraints, command)
        return
    if command.number(1) != 0.0:
        restraints.left_out(command, "an equation whose constant is not 0", "equations")
    else:
        _add_equation(restraints, command, command.fields[2:])


def _take_written(restraints: Restraints, command: Command) -> None:
    if command.field(1).upper() == "DEFI":
        if command.number(4) != 0.0:
            restraints.left_out(command, "an equation whose constant is not 0", "equations")
            restraints.is_open = False
        else:
            restraints.equations.append((command.where, []))
            restraints.is_open = True
    elif restraints.is_open:
        restraints.is_open = _extend(restraints, command, restraints.equations[-1][1], command.fields[2:])


def _add_equation(restraints: Restraints, command: Command, fields: tuple[str, ...]) -> None:
    """Take a typed equation; a further command with the same number adds terms."""
    number = command.field(0).upper()
    is_further = number.isdigit() and number in restraints.typed
    terms = restraints.typed[number] if is_further else []
    if number.isdigit():
        restraints.typed[number] = terms
    if not is_further:
        restraints.equations.append((command.where, terms))
    if terms or not is_further:  # a continuation without terms belongs to an omitted equation
        _extend(restraints, command, terms, fields)


def _extend(restraints: Restraints, command: Command, terms: list[Term], fields: tuple[str, ...]) -> bool:
    """Add the terms of fields (node, label, coefficient); without terms and with a finding for other than displacements."""
    shifted = Command(command.word, fields, command.line)
    for i in range(0, len(fields) - 2, 3):
        if not fields[i]:
            break
        label = fields[i + 1].upper()
        if label not in _DIRECTIONS:
            restraints.left_out(command, f"an equation with {label}, which is not a displacement", "equations")
            terms.clear()
            return False
        terms.append((int(shifted.number(i)), _DIRECTIONS[label], shifted.number(i + 2)))
    return True


def take_coupling(restraints: Restraints, command: Command) -> None:
    """Take a typed CP command: a set, a label, nodes."""
    if command.is_archived:
        restraints.left_out(
            command, "coupled nodes as CDWRITE writes them, which is not documented; write them as CE (CPTOCE)", "equations"
        )
        return
    label = command.field(1).upper()
    if label not in (*_DIRECTIONS, "ALL"):
        restraints.left_out(command, f"coupled nodes in {label}, which is not a displacement", "equations")
        return
    _, _, nodes = restraints.coupled.setdefault(command.field(0), (command.where, label, []))
    nodes.extend(int(Command(command.word, (word,), command.line).number(0)) for word in command.fields[2:] if word)


def take_rigid(restraints: Restraints, command: Command, selected: np.ndarray | None, components: dict[str, np.ndarray]) -> None:
    """Take a CERIG command: nodes that follow a leading node as a rigid body, in all directions."""
    label = command.field(2).upper()
    followers = _nodes(command.field(1), selected, components)
    if label not in ("", "ALL", "UXYZ") or followers is None:
        restraints.left_out(command, f"a rigid region of {command.field(1)!r} in {label or 'ALL'}", "points")
        return
    restraints.rigid.append((command.where, int(command.number(0)), [int(node) for node in followers]))


def _nodes(word: str, selected: np.ndarray | None, components: dict[str, np.ndarray]) -> np.ndarray | None:
    if word.upper() == "ALL":
        return selected
    if word.upper() in components:
        return components[word.upper()]
    try:
        return np.array([int(float(word))])
    except ValueError:
        return None


def turned_axes(angles: np.ndarray) -> np.ndarray:
    """Return the nodal axes, (3, 3) rows, from the angles THXY, THYZ, THZX in degrees: about z, then x, then y.  Local."""
    return Rotation.from_euler("ZXY", angles, degrees=True).as_matrix().T


def take_constraints(restraints: Restraints, draft: Draft) -> None:
    """Take supports as groups "D x", "D xy", ..., then equations and couplings, in the axes of the nodes.  Local.

    Raises
    ------
    MeshError : an equation has a node that does not exist
    """
    fixed = np.zeros((len(draft.numbers), 6), dtype=bool)
    for axis, nodes in restraints.fixed.items():
        wanted = np.array(sorted(nodes), dtype=np.int64)
        index, missing = index_of(draft.numbers, wanted)
        fixed[index[~np.isin(wanted, missing)], axis] = True
    draft.hold("D", fixed)
    rows = [("CE", where, terms) for where, terms in restraints.equations]
    for where, label, followers in restraints.coupled.values():
        for axis in range(3) if label == "ALL" else [_DIRECTIONS[label]]:
            rows += [("CP", where, [(node, axis, 1.0), (followers[0], axis, -1.0)]) for node in followers[1:]]
    for word, where, terms in rows:
        nodes = draft.find([node for node, _, _ in terms], f"{where}: {word}").tolist()
        draft.add_equation(word, where, [(node, axis, value) for node, (_, axis, value) in zip(nodes, terms, strict=True)])
