"""Loads of the static steps before the vibration: *CLOAD, *DLOAD, ..., at the end of those steps."""

from collections.abc import Hashable
from dataclasses import dataclass, field, replace

import numpy as np

from ...messages.errors import MeshError
from ...tables.constant_loads import Bolt, Force, MovedSupport, Pressure, Statics
from ...tables.table import Vector
from ..draft import vector
from ..model import LoadsAtRest
from .cards import Card, number
from .groups import add_faces
from .input_model import InputModel, Step
from .scopes import Scope
from .supports import fixed_dofs
from .temperatures import take_temperatures, temperatures_of
from .types import is_solid

WORD = "*STEP, PERTURBATION"
STATIC = "*STATIC"
LARGE = "*STEP, NLGEOM"
_TAKEN = ("CLOAD", "DLOAD", "DSLOAD", "TEMPERATURE")
_FACES = ("P1", "P2", "P3", "P4", "P5", "P6")
_OTHERS = {
    "FIELD": "values of a field",
    "INERTIA LOAD": "forces of inertia",
    "CONTACT INTERFERENCE": "surfaces pressed into each other",
}


@dataclass(eq=False)
class _Acting:
    """Loads at the end of a step.  A load replaces the load of an earlier step and adds to loads of the same step."""

    forces: dict[tuple[int, int], float] = field(default_factory=dict)  # node, direction from 1 in its axes
    names: dict[int, str] = field(default_factory=dict)  # node: the set named by its load
    faces: dict[tuple[int, int], float] = field(default_factory=dict)  # element, face from 1: pressure
    surfaces: dict[str, float] = field(default_factory=dict)  # pressure
    bolts: dict[str, float] = field(default_factory=dict)
    moved: dict[tuple[int, int], float] = field(default_factory=dict)  # node, direction from 1: displacement
    temperatures: dict[int, float] = field(default_factory=dict)  # by node
    heated: str = ""  # place of the temperatures in the file
    spin: tuple[float, ...] | None = None  # square of the speed, a point of the axis, its direction
    has_turned: bool = False  # the step has stated a rotation
    _stated: set[tuple[int, Hashable]] = field(default_factory=set)  # loads that the step has stated

    def begin(self, step: Step) -> None:
        """Remove the loads that the step replaces as a whole."""
        self._stated.clear()
        self.has_turned = False
        for keywords, tables in (
            (("CLOAD",), (self.forces, self.bolts)),
            (("DLOAD", "DSLOAD"), (self.faces, self.surfaces)),
            (("TEMPERATURE",), (self.temperatures,)),
        ):
            if any(card.keyword in keywords and card.parameter("OP") == "NEW" for _, card in step.cards):
                for table in tables:
                    table.clear()
                if "DLOAD" in keywords:
                    self.spin = None

    def put(self, table: dict, key: Hashable, value: float) -> None:
        """Add a load to one of the tables of this object."""
        is_stated = (id(table), key) in self._stated
        table[key] = table[key] + value if is_stated else value
        self._stated.add((id(table), key))


def take_statics(model: InputModel) -> None:
    """Take the loads at rest of the chosen step; add findings for other loads.

    Raises
    ------
    MeshError : values that are not numbers, sets that do not exist
    """
    at_rest, vibration = model.steps_at_rest, model.step
    acting, loaded = _Acting(), []
    for step in at_rest:
        if any(card.keyword in (*_TAKEN, *_OTHERS, "BOUNDARY") for _, card in step.cards):
            loaded.append(step)
            _take_step(model, step, acting)
    is_about = vibration is not None and vibration.is_perturbation
    after = [step for step in model.steps_until if (step is vibration if is_about else step not in at_rest)]
    if vibration is None or not loaded:
        take_temperatures(model, None if _are_heated(after) else {}, "")
        return
    if is_about and any(card.keyword == "BOUNDARY" for _, card in vibration.cards):
        _add_finding(model, "*BOUNDARY", vibration.cards[0][1].where, "the supports change between the loads and the vibration")
    _find_nonlinear(model, loaded, acting)
    is_large = any(map(_is_large, loaded)) and not _why_not_large(model, acting)
    word = _word(model)
    model.statics = replace(_composed(model, acting, loaded[-1], word), large=LARGE if is_large else "")
    take_temperatures(model, None if _are_heated(after) else acting.temperatures, acting.heated)
    effect = f"vibration about the loads of step {loaded[-1].number}: take them over, or state them in [statics]"
    _add_finding(model, word, vibration.cards[0][1].where, effect)


def _word(model: InputModel) -> str:
    """Return the word for loads at rest."""
    return WORD if model.step is not None and model.step.is_perturbation else STATIC


def _are_heated(steps: list[Step]) -> bool:
    return any(card.keyword == "TEMPERATURE" for step in steps for _, card in step.cards)


def _add_finding(model: InputModel, word: str, where: str, effect: str) -> None:
    """Add a finding that the statics of the scene resolve."""
    model.findings.add(word, where, effect, True, "statics")


def _find_nonlinear(model: InputModel, loaded: list[Step], acting: _Acting) -> None:
    """Add findings for effects that the statics of a scene lack, and always for large displacements."""
    why = _why_not_large(model, acting)
    for step in loaded:
        if _is_large(step):
            effect = f"large displacements under the loads; [statics] has small ones with {why}" if why else "large displacements"
            _add_finding(model, LARGE, step.cards[0][1].where, effect)
    for _, card in model.cards:
        if card.keyword == "PLASTIC":
            _add_finding(model, "*PLASTIC", card.where, "the loads may exceed yield; [statics] is elastic")


def _is_large(step: Step) -> bool:
    card = step.cards[0][1]
    return "NLGEOM" in card.parameters and card.parameter("NLGEOM", "YES") != "NO"


def _why_not_large(model: InputModel, acting: _Acting) -> str:
    """Return the loads that a scene allows only with small displacements; "" if the file has none."""
    if acting.faces or acting.surfaces:
        return "pressures, which do not follow the surface"
    return "bolts" if acting.bolts else "points that turn with their nodes" if model.points else ""


def _take_step(model: InputModel, step: Step, acting: _Acting) -> None:
    """Add the loads of one step to ``acting``."""
    head = step.cards[0][1]
    if not any(card.keyword == "STATIC" for _, card in step.cards):
        _add_finding(model, _word(model), head.where, f"vibration about the loads of step {step.number}, which is not *STATIC")
        return
    acting.begin(step)
    for scope, card in step.cards:
        if card.keyword in (*_TAKEN, "STATIC"):
            model.loading.add(card)
        if card.keyword in _TAKEN:
            _take_card(model, scope, card, acting)
        elif card.keyword in _OTHERS:
            _add_finding(model, f"*{card.keyword}", card.where, f"{_OTHERS[card.keyword]} load the structure before it vibrates")
        elif card.keyword == "BOUNDARY":
            _take_moved(model, scope, card, acting)


def _take_moved(model: InputModel, scope: Scope, card: Card, acting: _Acting) -> None:
    """Take moved supports of solids along model axes; add findings for other moved supports."""
    for words, where in card.lines():
        if len(words) < 2 or number(words[1]) is None:
            continue  # by name: held
        dofs, value = fixed_dofs(words, where)
        if not dofs:
            continue  # no displacement: a finding of the supports
        nodes = model.mesh.nodes(scope, words[0], where)
        bad = [name for name in card.parameters if name not in ("OP", "TYPE")]
        if value and (bad or card.parameter("TYPE", "DISPLACEMENT") != "DISPLACEMENT" or not _are_plain(model, nodes, dofs)):
            why = f", {bad[0]}" if bad else ""
            effect = f"a displacement other than 0 ({words[0]}{why}) loads the structure before it vibrates"
            _add_finding(model, "*BOUNDARY", where, effect)
            return
        acting.moved.update({(node, dof): value for node in nodes.tolist() for dof in dofs})


def _are_plain(model: InputModel, nodes: np.ndarray, dofs: set[int]) -> bool:
    """Return whether all nodes are in solids and in model axes, and no direction is a rotation."""
    return bool(model.grouped.of_solids[nodes].all()) and not np.isin(nodes, list(model.axes)).any() and dofs <= {1, 2, 3}


def _take_card(model: InputModel, scope: Scope, card: Card, acting: _Acting) -> None:
    for name in card.parameters:
        if name != "OP":
            _add_finding(model, f"*{card.keyword}, {name}", card.where, "a load that is not constant")
            return
    if card.keyword == "TEMPERATURE":
        acting.temperatures.update(temperatures_of(model, scope, card))
        acting.heated = card.where
        return
    for words, where in card.lines():
        if card.keyword == "CLOAD":
            _take_force(model, scope, words, where, acting)
        elif card.keyword == "DLOAD":
            _take_distributed(model, scope, words, where, acting)
        else:
            _take_pressure(model, scope, words, where, acting)


def _values(words: list[str], first: int, n: int, where: str, keyword: str) -> list[float]:
    """Return ``n`` numbers of a data line, from the field ``first`` on."""
    values = [number(word) for word in words[first : first + n]]
    if len(values) < n or None in values:
        raise MeshError(f"{where}: *{keyword} holds {','.join(words)[:60]!r} where numbers are expected")
    return [value for value in values if value is not None]


def _take_force(model: InputModel, scope: Scope, words: list[str], where: str, acting: _Acting) -> None:
    direction, value = _values(words, 1, 2, where, "CLOAD")
    if words[0].upper() in model.cuts:
        acting.put(acting.bolts, model.cuts[words[0].upper()], value)
        return
    nodes = model.mesh.nodes(scope, words[0], where)
    takes_force = model.grouped.of_solids[nodes] | np.isin(nodes, list(model.points))
    if direction not in (1.0, 2.0, 3.0) or not takes_force.all():
        what = "a moment" if direction in (4.0, 5.0, 6.0) else "a force in another direction than 1 to 3"
        _add_finding(model, "*CLOAD", where, f"{what if takes_force.all() else 'a force on a node of no solid'} ({words[0]})")
        return
    for node in nodes.tolist():
        acting.put(acting.forces, (node, int(direction)), value)
        acting.names[node] = "*CLOAD" if words[0].isdigit() else model.mesh.name_of(scope, words[0])


def _take_distributed(model: InputModel, scope: Scope, words: list[str], where: str, acting: _Acting) -> None:
    """Take a pressure on faces P1, P2, ... of elements, or a rotation of the whole structure."""
    label = words[1].upper() if len(words) > 1 else ""
    elements = model.mesh.elements(scope, words[0], where)
    if label == "CENTRIF":
        _take_rotation(model, elements, words, where, acting)
    elif label in _FACES:
        (value,) = _values(words, 2, 1, where, "DLOAD")
        for element in elements.tolist():
            acting.put(acting.faces, (element, _FACES.index(label) + 1), value)
    else:
        _add_finding(model, f"*DLOAD, {label}", where, f"a load {label} that [statics] does not have")


def _take_rotation(model: InputModel, elements: np.ndarray, words: list[str], where: str, acting: _Acting) -> None:
    spin = tuple(_values(words, 2, 7, where, "DLOAD"))
    is_turned = np.zeros(len(model.grouped.block_of), dtype=bool)
    is_turned[elements] = True
    solids = [is_turned[first : first + len(nodes)] for first, block, nodes in model.mesh.blocks if is_solid(block.word)]
    if not all(turned.all() for turned in solids) or spin[0] < 0.0 or not any(spin[4:]):
        _add_finding(
            model, "*DLOAD, CENTRIF", where, f"a rotation of {words[0]} alone, or about no axis; [statics] turns everything"
        )
        return
    if acting.spin is not None and (acting.has_turned or acting.spin[1:] != spin[1:]):
        which = "in the same step" if acting.has_turned else "about another axis"
        _add_finding(model, "*DLOAD, CENTRIF", where, f"a second rotation {which}")
    acting.spin, acting.has_turned = spin, True


def _take_pressure(model: InputModel, scope: Scope, words: list[str], where: str, acting: _Acting) -> None:
    name = model.mesh.name_of(scope, words[0])
    label = words[1].upper() if len(words) > 1 else ""
    if label != "P" or not model.grouped.has_faces(name):
        _add_finding(model, f"*DSLOAD, {label}", where, f"a load {label} on {words[0]} that [statics] does not have")
        return
    (value,) = _values(words, 2, 1, where, "DSLOAD")
    acting.put(acting.surfaces, name, value)


def _composed(model: InputModel, acting: _Acting, step: Step, word: str) -> LoadsAtRest:
    """Return the loads at rest, on new groups."""
    speed = 0.0 if acting.spin is None else float(np.sqrt(acting.spin[0]))
    _, *axis = (0.0,) * 7 if acting.spin is None else acting.spin
    bolts = {bolt.name: bolt.group for bolt in model.bolts}
    return LoadsAtRest(
        word=word,
        step=step.number,
        table=Statics.of_file(
            forces=tuple(_forces(model, acting)),
            pressures=tuple(_pressures(model, acting)),
            bolts=tuple(
                Bolt.of_file(name=name, group=bolts[name], force=abs(value)) for name, value in acting.bolts.items() if value
            ),
            displacements=tuple(_moved(model, acting)),
            rotation_speed=speed,
        ),
        axis=(axis[3], axis[4], axis[5]),
        axis_point=(axis[0], axis[1], axis[2]),
    )


def _forces(model: InputModel, acting: _Acting) -> list[Force]:
    """Return the forces in model axes: on points, and on groups of nodes with equal forces."""
    vectors: dict[int, np.ndarray] = {}
    for (node, direction), value in acting.forces.items():
        axes = model.axes.get(node, np.eye(3))
        if value and not np.isfinite(axes).all():
            raise MeshError(f"*CLOAD: node {model.mesh.numbers[node]} lies on the axis of its *TRANSFORM")
        vectors[node] = vectors.get(node, np.zeros(3)) + (value * axes[direction - 1] if value else 0.0)
    alike: dict[Vector, list[int]] = {}
    forces = []
    for node, values in vectors.items():
        force = vector(values)
        if not any(force):
            continue
        if node in model.points:
            forces.append(Force.of_file(point=model.points[node].name, force=force))
        else:
            alike.setdefault(force, []).append(node)
    for force, nodes in alike.items():
        names = {acting.names[node] for node in nodes}
        group = model.grouped.node_group(names.pop() if len(names) == 1 else "*CLOAD", np.array(nodes))
        forces.append(Force.of_file(group=group, force=vector(len(nodes) * value for value in force)))
    return forces


def _moved(model: InputModel, acting: _Acting) -> list[MovedSupport]:
    """Return the moved supports, on new groups of nodes with equal displacements."""
    vectors: dict[int, list[float]] = {}
    for (node, dof), value in acting.moved.items():
        if value:
            vectors.setdefault(node, [0.0] * 3)[dof - 1] = value
    alike: dict[Vector, list[int]] = {}
    for node, (x, y, z) in vectors.items():
        alike.setdefault((x, y, z), []).append(node)
    return [
        MovedSupport.of_file(group=model.grouped.node_group("*BOUNDARY moved", np.array(nodes)), displacement=by)
        for by, nodes in alike.items()
    ]


def _pressures(model: InputModel, acting: _Acting) -> list[Pressure]:
    """Return the pressures on faces of elements, on new groups, and those on surfaces of the file."""
    alike: dict[float, dict[int, list[int]]] = {}
    for (element, face), value in acting.faces.items():
        if value:
            alike.setdefault(value, {}).setdefault(face, []).append(element)
    pressures = []
    for i, (value, faces) in enumerate(alike.items(), 1):
        name = model.grouped.free_name(f"*DLOAD {i}")
        for face, elements in faces.items():
            add_faces(model.grouped, name, np.unique(elements), f"S{face}", "*DLOAD")
        pressures.append(Pressure.of_file(group=name, pressure=value))
    return pressures + [Pressure.of_file(group=name, pressure=value) for name, value in acting.surfaces.items() if value]
