"""The structure of an input file while the cards are read."""

from dataclasses import dataclass, field

import numpy as np

from ...messages.errors import MeshError
from ...messages.words import place
from ...tables.constant_loads import Bolt
from ...tables.joint import Joint
from ...tables.structure import Body, Mass, Material, Orientation, Point, Spring, Support, Tie
from ..draft import Findings, Term, Terms
from ..model import FileSectors, LoadsAtRest
from .cards import Card
from .groups import Grouped
from .mesh import FileMesh
from .scopes import Scope

_STRAIGHT = 1e-12  # smaller components of an axis are taken as 0


@dataclass(eq=False)
class Step:
    """The cards of one step, *STEP first."""

    number: int
    cards: list[tuple[Scope, Card]]

    @property
    def is_frequency(self) -> bool:
        """Whether it has a card *FREQUENCY."""
        return any(card.keyword == "FREQUENCY" for _, card in self.cards)

    @property
    def is_perturbation(self) -> bool:
        """Whether *STEP has the parameter PERTURBATION."""
        return "PERTURBATION" in self.cards[0][1].parameters

    @property
    def is_static(self) -> bool:
        """Whether it has a card *STATIC."""
        return any(card.keyword == "STATIC" for _, card in self.cards)


@dataclass(frozen=True, eq=False)
class Table:
    """Values of a material that depend on the temperature."""

    keyword: str
    where: str  # place of the first row with different values
    kind: str  # key of VALUES in elastic.py
    rows: np.ndarray  # (n, number of values + 1), the temperature last
    zero: float = 0.0  # reference temperature of an expansion
    is_of_temperature: bool = True  # False: also of other fields or a user routine, which are not read

    def at(self, temperature: float) -> np.ndarray:
        """Return the values interpolated between the rows, constant beyond them."""
        *columns, temperatures = self.rows[np.argsort(self.rows[:, -1], kind="stable")].T
        return np.array([np.interp(temperature, temperatures, column) for column in columns])


@dataclass(eq=False)
class InputModel:
    """The structure so far, and the cards that state it."""

    mesh: FileMesh
    grouped: Grouped
    cards: list[tuple[Scope, Card]]  # cards of the model, before its steps
    steps: list[Step]
    findings: Findings
    step: Step | None = None  # step whose conditions are taken; None: there are no steps
    is_named: bool = False  # whether the user named the step
    materials: dict[str, Material] = field(default_factory=dict)
    orientations: dict[str, Orientation] = field(default_factory=dict)
    tables: dict[str, list[Table]] = field(default_factory=dict)  # of materials that depend on the temperature
    axes_of_materials: set[Card] = field(default_factory=set)  # *ORIENTATION of sections with anisotropic materials
    bodies: dict[str, Body] = field(default_factory=dict)
    supports: list[Support] = field(default_factory=list)
    ties: list[Tie] = field(default_factory=list)
    joints: list[Joint] = field(default_factory=list)
    points: dict[int, Point] = field(default_factory=dict)  # by their node
    turns: dict[int, int] = field(default_factory=dict)  # node that holds the rotations of a point: node of the point
    coupled: list[tuple[int, int, str]] = field(default_factory=list)  # leading node, following node on no solid, place
    leading: dict[int, Card] = field(default_factory=dict)  # reference nodes that lead others and, so far, no node of a solid
    masses: list[Mass] = field(default_factory=list)
    springs: list[Spring] = field(default_factory=list)
    terms: Terms = field(default_factory=Terms)
    bolts: list[Bolt] = field(default_factory=list)
    cuts: dict[str, str] = field(default_factory=dict)  # name of the bolt, by the word for the node that tightens it
    statics: LoadsAtRest | None = None
    sectors: FileSectors | None = None
    loading: set[Card] = field(default_factory=set)  # cards of steps that become the statics
    axes: dict[int, np.ndarray] = field(default_factory=dict)  # node: (3, 3) rows of its axes by *TRANSFORM
    attached: set[int] = field(default_factory=set)  # nodes of masses, springs or equations

    @property
    def steps_at_rest(self) -> list[Step]:
        """The steps that lead to the state of vibration: before a *STEP, PERTURBATION, or up to a *STATIC chosen by the user."""
        if self.step is None or not (self.step.is_perturbation or (self.is_named and self.step.is_static)):
            return []
        return [step for step in self.steps_until if not step.is_perturbation]

    @property
    def steps_until(self) -> list[Step]:
        """The steps whose conditions hold in the chosen step: this step and the earlier ones, without perturbations."""
        before = [] if self.step is None else self.steps[: self.step.number]
        return [step for step in before if step is self.step or not step.is_perturbation]


def along_axis(model: InputModel, node: int, direction: int, factor: float) -> list[Term]:
    """Return the displacement of a node along one of its axes, from 1, times a factor, as terms in model axes, largest first."""
    along = model.axes.get(node, np.eye(3))[direction - 1]
    if np.isnan(along).any():
        at = place(model.mesh.points[node])
        raise MeshError(f"node {model.mesh.numbers[node]} at {at} lies on the axis of its *TRANSFORM, where nothing is radial")
    terms = [(node, axis, factor * float(value)) for axis, value in enumerate(along) if abs(value) > _STRAIGHT]
    return sorted(terms, key=lambda term: -abs(term[2]))
