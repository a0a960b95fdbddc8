"""Supports and equations of bulk data; displacements of a grid point are those of its own system (field CD)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...tables.structure import Support
from ..model import Equations, held_alike
from .content import Content

_NAMES = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True)
class Held:
    """Supports in the axes of the model, and those in others as rows of equations."""

    supports: tuple[Support, ...]
    turned: list[tuple[str, list[tuple[int, int, float]]]]  # where, (position of a node, axis, coefficient)


def supports(content: Content, points: set[str], of_rigid: dict[int, str]) -> Held:
    """Return what SPC, SPC1 and the grid points themselves hold.  Local.

    ``of_rigid`` names the connected point of a grid point that leads a rigid element, which has rotations, too.
    """
    held = np.zeros((len(content.numbers), 6), dtype=bool)
    defaults = getattr(content.cards.grdset, "ps", None) or ""
    for number, node in content.cards.nodes.items():
        _hold(held, content, [number], str(node.ps or defaults), "GRID")
    for card in _chosen(content, "SPC", content.cards.spcs, content.cards.spcadds):
        if card.type == "SPC1":
            _hold(held, content, card.nodes, card.components, "SPC1")
        elif card.type == "SPC":
            for node, components, value in zip(card.nodes, card.components, card.enforced, strict=True):
                if value:
                    content.left_out("SPC", int(node), f"a displacement of {value} other than 0", "supports")
                else:
                    _hold(held, content, [node], components, "SPC")
        else:
            content.left_out(card.type, int(card.conid), "a support of a kind that is not followed", "supports")
    made, turned = [], []
    for number, name in of_rigid.items():
        i = content.nodes_of([number], "a rigid element")[0]
        fix = tuple(_NAMES[k] for k in np.flatnonzero(held[i]))
        axes = axes_of(content, number, content.points[i])
        parts = held[i, :3], held[i, 3:]
        if axes is not None and any(part.any() and not part.all() for part in parts):
            effect = "a support in turned axes of a grid point that leads a rigid element"
            content.left_out("SPC", number, effect, "supports")
        elif fix and name in points:
            made.append(Support.of_file(point=name, fix=fix))
        held[i] = False
    for i in np.flatnonzero(held[:, :3].any(axis=1) & ~held[:, :3].all(axis=1)):
        axes = axes_of(content, int(content.numbers[i]), content.points[i])
        if axes is not None:
            where = f"SPC of grid point {content.numbers[i]} in turned axes"
            turned += [(where, [(int(i), k, float(axes[axis, k])) for k in range(3)]) for axis in np.flatnonzero(held[i, :3])]
            held[i] = False
    for directions, nodes in held_alike(held[:, :3]):
        fix = tuple(_NAMES[axis] for axis in directions)
        made.append(Support.of_file(group=content.group(f"SPC {''.join(fix)}", nodes), fix=fix))
    return Held(tuple(made), turned)


def _hold(held: np.ndarray, content: Content, nodes: Any, components: str, where: str) -> None:
    digits = [int(c) - 1 for c in str(components) if c in "123456"]
    if digits:
        held[content.nodes_of(map(int, nodes), where)[:, None], digits] = True


def _chosen(content: Content, word: str, sets: dict, added: dict) -> list[Any]:
    """Return the cards of the set that the case control names, or of the only one there is, with a note where it names none."""
    deck, wanted = content.cards.case_control_deck, set()
    for subcase in deck.subcases.values() if deck is not None else ():
        if word in subcase.params:
            wanted.add(int(subcase.params[word][0]))
    if len(wanted) > 1:
        effect = f"the case control names several sets; the first, {min(wanted)}, is taken"
        content.left_out(word, min(wanted), effect, "supports" if word == "SPC" else "equations")
    everything = {*sets, *added}
    if not wanted and len(everything) > 1:
        content.left_out(word, min(everything), "several sets and no case control that names one", "supports")
    number = min(wanted or everything or {0})
    if not wanted and len(everything) == 1 and deck is not None:
        effect = f"the case control names no set; the only one there is, {number}, is taken"
        content.left_out(word, number, effect, "supports" if word == "SPC" else "equations", changes=False)
    members = [one for card in added.get(number, ()) for one in card.sets] if number in added else [number]
    return [card for member in members for card in sets.get(member, ())]


def axes_of(content: Content, number: int, point: np.ndarray) -> np.ndarray | None:
    """Return the axes of a grid point's displacements, (3, 3) rows, or None where they are those of the model.  Local."""
    node = content.cards.nodes.get(number)
    if node is None:  # a plain grid point
        return None
    coord = node.cd_ref if getattr(node, "cd_ref", None) is not None else content.cards.coords.get(node.cd)
    if coord is None or coord.cid == 0:
        return None
    axes = np.asarray(coord.beta(), dtype=float)
    if coord.type in ("CORD2C", "CORD1C", "CORD2S", "CORD1S"):
        local = axes @ (point - np.asarray(coord.origin))
        axes = _local_axes(local, is_sphere=coord.type.endswith("S")) @ axes
    return None if np.allclose(axes, np.eye(3), atol=1e-12) else axes


def _local_axes(at: np.ndarray, is_sphere: bool) -> np.ndarray:
    """Return e_r, e_theta, e_z at a point of a cylindrical system, or e_r, e_theta, e_phi of a spherical one, as rows."""
    phi = np.arctan2(at[1], at[0])
    around = np.array([-np.sin(phi), np.cos(phi), 0.0])
    outward = np.array([np.cos(phi), np.sin(phi), 0.0])
    if not is_sphere:
        return np.stack([outward, around, [0.0, 0.0, 1.0]])
    theta = np.arctan2(np.hypot(at[0], at[1]), at[2])
    radial = np.sin(theta) * outward + np.cos(theta) * np.array([0.0, 0.0, 1.0])
    down = np.cos(theta) * outward - np.sin(theta) * np.array([0.0, 0.0, 1.0])
    return np.stack([radial, down, around])


def equations(
    content: Content, turned: list[tuple[str, list[tuple[int, int, float]]]], of_rigid: dict[int, str]
) -> Equations | None:
    """Return the equations of MPC and of supports in turned axes, in model axes; None without any.  Local."""
    rows = list(turned)
    for card in _chosen(content, "MPC", content.cards.mpcs, content.cards.mpcadds):
        terms: list[tuple[int, int, float]] = []
        for node, component, value in zip(card.nodes, card.components, card.coefficients, strict=True):
            if str(component) not in "123":
                content.left_out("MPC", int(card.conid), "an equation with a rotation or a scalar point", "equations")
                break
            i = int(content.nodes_of([node], "MPC")[0])
            if int(node) in of_rigid and not content.of_solids[i]:
                effect = f"an equation of grid point {node}, which leads a rigid element"
                content.left_out("MPC", int(card.conid), effect, "equations")
                break
            axes = axes_of(content, int(node), content.points[i])
            row = np.eye(3)[int(component) - 1] if axes is None else axes[int(component) - 1]
            terms += [(i, k, float(value * row[k])) for k in np.flatnonzero(row)]
        else:
            rows.append((f"MPC {card.conid}", terms))
    if not rows:
        return None
    flat = [(i, *term) for i, (_, own) in enumerate(rows) for term in own]
    equation, nodes, directions, values = (np.array(column) for column in zip(*flat, strict=True))
    return Equations(equation, nodes, directions, values, tuple(where for where, _ in rows), np.arange(len(rows)) < len(turned))
