"""Connections of nodes: ties, couplings, rigid bodies, cuts."""

import numpy as np

from ...messages.errors import MeshError
from ...messages.words import counted, hint
from ...tables.constant_loads import Bolt
from ...tables.structure import Point, Tie
from ..draft import group_below, vector, weights_in_order
from ..model import Finding
from .cards import Card, number, values_of
from .findings import PART
from .input_model import InputModel
from .scopes import Scope


def take_connections(model: InputModel) -> None:
    """Take ties, couplings, rigid bodies and cuts.  Raises MeshError: surfaces, sets or nodes that do not exist."""
    coupling: tuple[Scope, Card] | None = None
    for scope, card in model.cards:
        if card.keyword == "COUPLING":
            coupling = scope, card
        elif card.keyword in ("KINEMATIC", "DISTRIBUTING"):
            if coupling is None:
                raise MeshError(f"{card.where}: *{card.keyword} follows no *COUPLING")
            _take_coupling(model, *coupling, card)
            coupling = None
        elif card.keyword in _TAKEN:
            _TAKEN[card.keyword](model, scope, card)
    _add_leading(model)


def surface_of(model: InputModel, scope: Scope, word: str, where: str) -> str:
    """Return the name of the group of a surface.  Raises MeshError: there is no such surface."""
    names, key = model.mesh.find(scope, word)
    if key not in names.surfaces:
        near = hint(key, names.surfaces, lambda near: repr(model.mesh.spelled(near)))
        raise MeshError(f"{where}: there is no *SURFACE {word!r}{near}")
    return names.scope.named(model.mesh.spelled(key))


def faces_of(model: InputModel, scope: Scope, word: str, where: str) -> str | None:
    """Return the group of a surface's faces, for nodes the outer faces between them; None if these do not cover the nodes."""
    name = surface_of(model, scope, word, where)
    if model.grouped.has_faces(name):
        return name
    if name not in model.grouped.groups:
        return None
    made = f"{name} (faces)"
    if made not in model.grouped.groups:
        nodes = model.grouped.nodes_of(name)
        is_in = np.zeros(len(model.mesh.points), dtype=bool)
        is_in[nodes] = True
        model.grouped.add_faces_between(made, is_in)
        if made not in model.grouped.groups or not np.array_equal(model.grouped.nodes_of(made), nodes):
            model.grouped.groups.pop(made, None)
            return None
    return made


def _take_tie(model: InputModel, scope: Scope, card: Card) -> None:
    """Take a tie: each line has slave and master."""
    special = [key for key in ("CYCLICSYMMETRY", "MULTISTAGE", "FLUIDPERIODIC") if key in card.parameters]
    for words, where in card.lines():
        if len(words) < 2:
            raise MeshError(f"{where}: *TIE: expected two surfaces")
        if special:
            what = {"CYCLICSYMMETRY": "CYCLIC SYMMETRY"}.get(special[0], special[0])
            part = PART if special[0] == "CYCLICSYMMETRY" else ""
            model.findings.add(f"*TIE, {what}", where, "faces of a sector that meet those of the next one", True, part)
            continue
        tie(model, scope, words, where, card)


def tie(model: InputModel, scope: Scope, words: list[str], where: str, card: Card) -> None:
    """Glue the first surface of a line to the second."""
    first, second = (faces_of(model, scope, word, where) for word in words[:2])
    if first is None or second is None:
        role = words[0] if first is None else words[1]
        effect = f"{words[0]} tied to {words[1]}: the nodes of {role} are not those of whole faces of solids"
        finding = Finding(
            word=f"*{card.keyword}", where=where, effect=effect, changes=True, part="ties", surfaces=(words[0], words[1])
        )
        model.findings.take(finding)
        return
    tolerance, name = _number(card, "POSITIONTOLERANCE"), card.parameters.get("NAME")
    model.ties.append(Tie.of_file(surfaces=(first, second), name=name or None, tolerance=tolerance or None))


def _number(card: Card, name: str) -> float | None:
    """Return a parameter as a number; None if the card does not state it."""
    if name not in card.parameters:
        return None
    value = number(card.parameters[name])
    if value is None:
        raise MeshError(f"{card.where}: *{card.keyword}, {name}={card.parameters[name]}: expected a number")
    return value


def _single(model: InputModel, scope: Scope, word: str, card: Card) -> int:
    """Return the single node given by a number or a set."""
    nodes = model.mesh.nodes(scope, word, card.where)
    if len(nodes) != 1:
        raise MeshError(
            f"{card.where}: *{card.keyword}: {word!r} holds {counted(len(nodes), 'node')}; a reference node is a single node"
        )
    return int(nodes[0])


def _add_point(model: InputModel, node: int, nodes: np.ndarray, group: str, connection: str, card: Card) -> None:
    """Add a point at a node, connected to other nodes; not at a node of a solid, nor twice at a node."""
    name, is_solid = "", model.grouped.of_solids[nodes]
    others = nodes[(nodes != node) & ~is_solid].tolist() if connection == "rigid" else []
    model.coupled += [(node, int(other), f"*{card.keyword}, {card.where}") for other in others]
    word, number = f"*{card.keyword}", model.mesh.numbers[node]
    n_loose = np.count_nonzero((nodes != node) & ~is_solid)
    nodes = nodes[(nodes != node) & is_solid]
    if connection == "distributing" and n_loose and len(nodes):
        effect = f"the reference node {number} is a mean with {counted(n_loose, 'node')} of no solid, which do not count here"
        model.findings.add(word, card.where, effect, True, "points")
    if others and not len(nodes) and not model.grouped.of_solids[node]:
        model.leading.setdefault(node, card)
        return
    if model.grouped.of_solids[node] or not len(nodes):
        mean = "is the mean of nodes of no solid" if connection == "distributing" else "holds no node of a solid"
        why = "is a node of a solid itself" if len(nodes) else mean
        model.findings.add(word, card.where, f"the reference node {number} {why}: nothing here follows it", True, "points")
        return
    if node in model.points:
        first = model.points[node]
        if first.connection != connection or connection != "rigid":
            effect = f"the reference node {number} has a connection already, {first.name!r}"
            model.findings.add(word, card.where, effect, True, "points")
            return
        name, nodes = first.name, np.union1d(nodes, model.grouped.nodes_of(first.group))
        group = f"{first.group} and {group}"
    _set_point(model, node, name or card.parameters.get("CONSTRAINTNAME", ""), model.grouped.node_group(group, nodes), connection)


def _set_point(model: InputModel, node: int, name: str, group: str, connection: str) -> None:
    """Set the point at a node, named after the node if its name is empty or that of another."""
    taken = {point.name for other, point in model.points.items() if other != node}
    name = plain(name if name and name not in taken else f"node {model.mesh.numbers[node]}")
    position = vector(model.mesh.points[node])
    model.points[node] = Point.of_file(name=name, position=position, group=group, connection=connection)


def _add_leading(model: InputModel) -> None:
    """Add the points at reference nodes that lead other reference nodes alone, once all of these are known."""
    follows: dict[int, list[int]] = {}
    for leader, node, _ in model.coupled:
        follows.setdefault(leader, []).append(node)
    groups = {node: point.group for node, point in model.points.items()}
    for node, card in model.leading.items():
        if node in model.points:
            continue
        group = group_below(node, follows, groups)
        if group is None:
            effect = (
                f"the reference node {model.mesh.numbers[node]} leads no node of a solid, nor a reference node that leads some"
            )
            model.findings.add(f"*{card.keyword}", card.where, effect, True, "points")
        else:
            _set_point(model, node, card.parameters.get("CONSTRAINTNAME", ""), group, "equations")


def plain(name: str) -> str:
    """Return a name without the characters that names in a scene may not have."""
    return "".join("_" if sign in ',"/\\' else sign for sign in name).strip()


def _take_coupling(model: InputModel, scope: Scope, card: Card, kind: Card) -> None:
    surface = surface_of(model, scope, card.parameters.get("SURFACE", ""), card.where)
    node = _single(model, scope, card.parameters.get("REFNODE", ""), card)
    name = card.parameters.get("CONSTRAINTNAME", "")
    if "INFLUENCERADIUS" in card.parameters:
        model.findings.add("*COUPLING, INFLUENCE RADIUS", card.where, f"{name}: a part of its surface", True, "points")
        return
    if kind.keyword == "KINEMATIC" and not _holds_all(model, kind, name):
        return
    nodes = model.grouped.nodes_of(surface) if surface in model.grouped.groups else np.zeros(0, dtype=np.int64)
    connection = "rigid" if kind.keyword == "KINEMATIC" else "distributing"
    if kind.parameter("WEIGHTINGMETHOD", "UNIFORM") != "UNIFORM":
        model.findings.add("*DISTRIBUTING, WEIGHTING METHOD", kind.where, f"{name}: weights by distance", True, "points")
        return
    _add_point(model, node, nodes, surface, connection, card)


def _holds_all(model: InputModel, kind: Card, name: str) -> bool:
    """Return whether all three translations follow; otherwise add a finding."""
    dofs: set[int] = set()
    lines = list(kind.lines())
    for words, where in lines:
        values = values_of(",".join(words[-2:] if not words[0].isdigit() or len(words) > 2 else words).encode())
        if values is None or not len(values):
            raise MeshError(f"{where}: *{kind.keyword} holds {','.join(words)[:60]!r} where numbers are expected")
        dofs |= set(range(int(values[0]), int(values[-1]) + 1))
    if lines and not {1, 2, 3} <= dofs:
        effect = f"{name}: only directions {', '.join(map(str, sorted(dofs)))} follow"
        model.findings.add(f"*{kind.keyword}", kind.where, effect, True, "points")
        return False
    return True


def _take_rigid_body(model: InputModel, scope: Scope, card: Card) -> None:
    """Take a rigid body of nodes or elements; its elements add mass, and their stiffness has no effect."""
    word = card.parameters.get("REFNODE", "")
    if "ANALYTICALSURFACE" in card.parameters or not word:
        model.findings.add("*RIGID BODY", card.where, "a rigid surface or a body without a reference node", True)
        return
    parts = [np.zeros(0, dtype=np.int64)]
    for key in ("NSET", "PINNSET", "TIENSET"):
        if key in card.parameters:
            parts.append(model.mesh.nodes(scope, card.parameters[key], card.where))
    if "ELSET" in card.parameters:
        parts.append(model.mesh.nodes_of(model.mesh.elements(scope, card.parameters["ELSET"], card.where)))
    node = _single(model, scope, word, card)
    _add_point(model, node, np.concatenate(parts), f"rigid body of node {model.mesh.numbers[node]}", "rigid", card)
    if "ROTNODE" in card.parameters and node in model.points:
        model.turns[_single(model, scope, card.parameters["ROTNODE"], card)] = node


def _take_kinematic_coupling(model: InputModel, scope: Scope, card: Card) -> None:
    node = _single(model, scope, card.parameters.get("REFNODE", ""), card)
    if not _holds_all(model, card, f"node {model.mesh.numbers[node]}"):
        return
    nodes = np.concatenate([model.mesh.nodes(scope, words[0], where) for words, where in card.lines()])
    _add_point(model, node, nodes, f"coupled to node {model.mesh.numbers[node]}", "rigid", card)


def _take_distributing_coupling(model: InputModel, scope: Scope, card: Card) -> None:
    """Take a coupling with stated weights; its reference node is the only node of the element in ELSET."""
    elements = model.mesh.elements(scope, card.parameter("ELSET"), card.where)
    at = model.mesh.nodes_of(elements)
    lines = list(card.lines())
    if len(at) != 1:
        model.findings.add("*DISTRIBUTING COUPLING", card.where, "an element with several nodes", True, "points")
        return
    of_lines = [model.mesh.nodes(scope, words[0], where) for words, where in lines]
    stated = [_weight(words, where) for words, where in lines]
    nodes, weights = np.concatenate(of_lines), np.repeat(stated, [len(of_line) for of_line in of_lines])
    group = f"coupled to node {model.mesh.numbers[at[0]]}"
    _find_lever(model, int(at[0]), np.unique(nodes), card)
    before = model.points.get(int(at[0]))
    _add_point(model, int(at[0]), nodes, group, "distributing", card)
    if model.points.get(int(at[0])) is not before:
        counts = model.grouped.of_solids[nodes] & (nodes != at[0])
        in_order = weights_in_order(model.mesh.numbers[nodes[counts]], weights[counts])
        model.points[int(at[0])] = model.points[int(at[0])].with_keys(weights=in_order)


def _weight(words: list[str], where: str) -> float:
    """Return the weight on a line of a *DISTRIBUTING COUPLING, 1 if it states none; MeshError: not a number above 0."""
    value = number(words[1]) if len(words) > 1 and words[1] else 1.0
    if value is None or not value > 0.0:
        raise MeshError(f"{where}: *DISTRIBUTING COUPLING: a weight is {words[1][:60]!r}, not a number above 0")
    return value


def _find_lever(model: InputModel, node: int, nodes: np.ndarray, card: Card) -> None:
    """Add a note if a reference node is not at the centroid of its nodes, where Abaqus and CalculiX differ."""
    points = model.mesh.points[nodes]
    middle = points.mean(axis=0)
    if np.linalg.norm(model.mesh.points[node] - middle) > 1e-6 * np.linalg.norm(points - middle, axis=1).max():
        number = model.mesh.numbers[node]
        effect = f"node {number} is not at the centroid of its nodes and turns with them, as in Abaqus; CalculiX uses their mean"
        model.findings.add("*DISTRIBUTING COUPLING", card.where, effect, False, "points")


def _take_mpc(model: InputModel, scope: Scope, card: Card) -> None:
    """Take the exactly equivalent types: equal displacements, and beams from nodes to a reference node."""
    beams: dict[int, list[np.ndarray]] = {}
    for words, where in card.lines():
        kind, members = words[0].upper(), [word for word in words[1:] if word]
        sets = [model.mesh.nodes(scope, word, where) for word in members]
        if kind in ("TIE", "PIN") and len(sets) == 2 and len(sets[1]) in (1, len(sets[0])):
            for first, second in zip(sets[0], np.broadcast_to(sets[1], len(sets[0])), strict=True):
                for axis in range(3):
                    model.terms.add([(int(first), axis, 1.0), (int(second), axis, -1.0)], f"{where}: *MPC {kind}")
            model.attached.update(int(node) for nodes in sets for node in nodes)
        elif kind == "BEAM" and len(sets) == 2 and len(sets[1]) == 1 and not model.grouped.of_solids[sets[1][0]]:
            beams.setdefault(int(sets[1][0]), []).append(sets[0])
        else:
            effect = f"a connection of {', '.join(members[:6])} that is not modelled"
            model.findings.add(f"*MPC {kind}", where, effect, True, "equations")
    for node, parts in beams.items():
        number = model.mesh.numbers[node]
        _add_point(model, node, np.concatenate(parts), f"beams to node {number}", "rigid", card)


def _take_cut(model: InputModel, scope: Scope, card: Card) -> None:
    """Take the cut of a bolt, which has no effect until the scene tightens it."""
    if "SURFACE" not in card.parameters:
        model.findings.add("*PRE-TENSION SECTION", card.where, "a cut through elements that are not solids", True)
        return
    group = surface_of(model, scope, card.parameters["SURFACE"], card.where)
    force = _tightened(model, card.parameter("NODE"))
    model.bolts.append(Bolt.of_file(name=plain(group), group=group, force=number(force)))
    model.cuts[card.parameter("NODE")] = plain(group)
    stated = f", in the file with {force}" if force else ""
    effect = f"a cut to be tightened{stated}: [[statics.bolts]] with group = {group!r}; until then the shank is whole"
    model.findings.add("*PRE-TENSION SECTION", card.where, effect, False)


def _tightened(model: InputModel, node: str) -> str:
    """Return the force, as "9000", by which a step loads the node of a cut, or an empty text."""
    loads = [
        words[2]
        for step in model.steps
        for _, card in step.cards
        if card.keyword == "CLOAD"
        for words, _ in card.lines()
        if len(words) > 2 and node and words[0].upper() == node
    ]
    return loads[0] if loads else ""


_TAKEN = {
    "TIE": _take_tie,
    "RIGID BODY": _take_rigid_body,
    "KINEMATIC COUPLING": _take_kinematic_coupling,
    "DISTRIBUTING COUPLING": _take_distributing_coupling,
    "MPC": _take_mpc,
    "PRE-TENSION SECTION": _take_cut,
}
