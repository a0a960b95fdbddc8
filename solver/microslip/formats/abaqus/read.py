"""Read a complete input file of Abaqus or CalculiX: the mesh and all other data of the structure."""

from dataclasses import replace

from ...messages.errors import MeshError
from ...messages.words import counted, verb
from ..draft import Findings
from ..model import FileModel
from . import cyclic
from .cards import Card, read_cards
from .connections import take_connections
from .contact import take_contact
from .discrete import take_discrete
from .equations import take_equations
from .findings import REFUSED, TAKEN, add_card, known
from .generated import GENERATING_CARDS
from .groups import grouped
from .input_model import InputModel, Step
from .mesh import CARDS, FileMesh, finish
from .parameters import in_full
from .properties import take_materials, take_sections
from .scopes import Scope, in_scopes
from .statics import take_statics
from .steps import chosen_step, table_of_steps
from .supports import take_supports, take_transforms

_MESH_CARDS = CARDS | GENERATING_CARDS
_OF_ONE_STEP = ("MODEL CHANGE", "CONTACT PAIR", "SELECT CYCLIC SYMMETRY MODES")  # in a later step they change that step alone
_TAKEN = {" ".join(word.split()) for word in TAKEN.split(",")}


def read_inp(path: str, step: int | None = None) -> FileModel:
    """Read an input file of Abaqus or CalculiX with its included files.  Local.

    ``step`` is the number of the step whose conditions are taken; None: the first step with *FREQUENCY, or the first step.
    Materials, bodies (one per section), supports, ties, couplings, rigid bodies, masses, springs, equations and the loads at rest
    are taken over; all other entries become findings.

    Raises
    ------
    MeshError without the file's name: the file is damaged, uses unsupported keywords, or does not have the step.
    """
    cards = read_cards(path)
    for i, card in enumerate(cards):
        cards[i] = card = _in_full(card)
        if card.keyword in REFUSED:
            raise MeshError(f"{card.where}: the keyword *{card.keyword} is not supported; {REFUSED[card.keyword]}")
    scoped_cards = in_scopes(cards)
    mesh = FileMesh()
    for scope, card in scoped_cards:
        names = mesh.of(scope)
        if card.keyword in _MESH_CARDS:
            _MESH_CARDS[card.keyword](mesh, names, card)
        if card.keyword in ("NODE", "ELEMENT") and not scope.name:
            card.pieces.clear()  # frees the longest texts, except parts that further instances read again
    every = mesh.names.values()
    if not any(names.blocks for names in every) or not any(names.given_nodes for names in every):
        raise MeshError("the file holds no *NODE and *ELEMENT blocks that this program reads")
    finish(mesh)
    before, steps = _steps(scoped_cards)
    model = InputModel(mesh, grouped(mesh), before, steps, Findings(), chosen_step(steps, step), step is not None)
    take_materials(model)
    take_sections(model)
    take_transforms(model)
    take_connections(model)
    cyclic.take_cyclic(model)
    take_contact(model)
    take_equations(model)
    take_discrete(model)
    take_supports(model)
    take_statics(model)
    model.materials = {name: material.with_axes() for name, material in model.materials.items()}
    _find_rest(model)
    return _composed(model)


def _in_full(card: Card) -> Card:
    """Return a card with keyword and parameters in full form."""
    card = replace(card, keyword=known(card.keyword))
    return replace(card, parameters=in_full(card)[0])


def _steps(scoped_cards: list[tuple[Scope, Card]]) -> tuple[list[tuple[Scope, Card]], list[Step]]:
    """Return the cards of the model and those of each step."""
    before: list[tuple[Scope, Card]] = []
    steps: list[Step] = []
    is_inside = False
    for scope, card in scoped_cards:
        if card.keyword == "STEP":
            if is_inside:
                raise MeshError(f"{card.where}: *STEP within another; *END STEP is missing before it")
            steps.append(Step(len(steps) + 1, []))
            is_inside = True
        (steps[-1].cards if is_inside else before).append((scope, card))
        if card.keyword == "END STEP":
            is_inside = False
    return before, steps


def _find_unknown_parameters(model: InputModel) -> None:
    """Add findings for unknown parameters of cards that are taken over."""
    for _, card in model.cards + [entry for step in model.steps_until for entry in step.cards]:
        for name in in_full(card)[1]:
            model.findings.add(f"*{card.keyword}, {name}", card.where, "a parameter unknown to this program", True)


def _find_rest(model: InputModel) -> None:
    """Add findings for every card that is not taken over."""
    _find_unknown_parameters(model)
    for where, n in model.mesh.short.items():
        effect = f"{counted(n, 'line')} {verb(n, 'hold')} fewer coordinates than others; the missing ones are 0, as in CalculiX"
        model.findings.add("*NODE", where, effect, False)
    for where, (kind, text, first) in model.mesh.missing.items():
        model.findings.add(f"*{kind}", where, f"{text}, the first is {first}", False)
    for _, card in model.cards:
        if card.keyword == "INITIAL CONDITIONS":
            _find_initial(model, card)
        elif card.keyword not in _TAKEN and card.keyword != cyclic.WORD:
            add_card(model.findings, card)
    if model.steps and model.steps[-1].cards[-1][1].keyword != "END STEP":
        effect = "it is missing: the file may be truncated"
        model.findings.add("*END STEP", "the last line", effect, False)
    for step in model.steps:
        for _, card in step.cards:
            counts = step in model.steps_until
            if card.keyword not in _TAKEN and card not in model.loading and (counts or card.keyword not in _OF_ONE_STEP):
                add_card(model.findings, card)


def _find_initial(model: InputModel, card: Card) -> None:
    kind = card.parameter("TYPE")
    if kind in ("TEMPERATURE", "VELOCITY", "ROTATING VELOCITY", "PLASTIC STRAIN", "HARDENING", "PRESSURE"):
        effect, changes = "of no effect on what is taken over", False
    else:
        effect, changes = "an initial state of the structure before it vibrates", True
    model.findings.add(f"*INITIAL CONDITIONS, TYPE={kind}", card.where, effect, changes)


def _composed(model: InputModel) -> FileModel:
    """Return the model: mesh, equations, tables, findings.  Local."""
    mesh = model.mesh
    notes = tuple(
        f"{counted(len(nodes), 'element')} of *ELEMENT, TYPE={block.word} {verb(len(nodes), 'are')} not cells of the mesh"
        for _, block, nodes in mesh.blocks
        if block.kind is None
    )
    return FileModel(
        mesh.points,
        mesh.numbers,
        tuple(model.grouped.cells),
        model.grouped.groups,
        notes,
        materials=model.materials,
        orientations=model.orientations,
        bodies=model.bodies,
        supports=tuple(model.supports),
        ties=tuple(model.ties),
        joints=tuple(model.joints),
        connected=tuple(model.points.values()),
        masses=tuple(model.masses),
        springs=tuple(model.springs),
        equations=model.terms.equations(),
        bolts=tuple(model.bolts),
        statics=model.statics,
        cyclic=model.sectors,
        steps=tuple(table_of_steps(model)),
        step=0 if model.step is None else model.step.number,
        findings=model.findings.all(),
        facts=tuple(_facts(model)),
    )


def _facts(model: InputModel) -> list[str]:
    """Return the facts listed with the model: instances and their numbering."""
    facts = []
    instances = [names for names in model.mesh.names.values() if names.scope.name]
    if instances:
        named = ", ".join(f"{names.scope.name} ({counted(len(names.node_numbers), 'node')})" for names in instances)
        facts.append(f"{len(instances)} instances: {named}")
    for what, raised in zip(("node", "element"), model.mesh.offsets, strict=True):
        if raised:
            facts.append(
                f"instances share {what} numbers: numbers of the second are raised by {raised}, of the third by "
                f"{2 * raised}, and so on; the assembly comes last"
            )
    return facts
