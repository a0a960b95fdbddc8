"""The structure of a file while its reader assembles it: operations that the readers of all programs share."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .. import elements
from ..messages.errors import MeshError
from ..tables.structure import Mass, Point, Spring, Support
from ..tables.table import Vector
from .model import KINDS, Cells, Equations, FileModel, Finding, Group, fixed_alike, index_of

NAMES = ("x", "y", "z", "rx", "ry", "rz")  # directions of a node with rotations
Term = tuple[int, int, float]  # position of a node; axis 0 to 2, for a point 0 to 5; coefficient


def vector(values: Iterable[float]) -> Vector:
    """Return three numbers as a tuple, the form of vectors in scene tables.  Local."""
    x, y, z = map(float, values)
    return x, y, z


def weights_in_order(numbers: np.ndarray, weights: np.ndarray) -> str | tuple[float, ...]:
    """Return ``weights`` of a point for nodes of the given numbers, (n,) each, in ascending order; "equal" if they are.

    Local.  Weights of a repeated node add up.
    """
    unique, at = np.unique(numbers, return_inverse=True)
    total = np.bincount(at, weights, minlength=len(unique))
    is_equal = np.ptp(total) <= 1e-12 * total.max() if len(total) else True
    return "equal" if is_equal else tuple(map(float, total))


@dataclass(eq=False)
class Findings:
    """Entries of a file that its reader does not take over; equal findings appear once, with the place of the first."""

    _places: dict[Finding, list[str]] = field(default_factory=dict)  # the places of each finding, stored without its place

    def add(self, word: str, where: str, effect: str, changes: bool = True, part: str = "", is_taken: bool = False) -> None:
        """Add a finding: the word, its place in the file, and the effect of leaving it out, or the difference.  Local."""
        self.take(Finding(word=word, where=where, effect=effect, changes=changes, part=part, is_taken=is_taken))

    def take(self, finding: Finding) -> None:
        """Add a finding.  Local."""
        self._places.setdefault(replace(finding, where=""), []).append(finding.where)

    def all(self) -> tuple[Finding, ...]:
        """Return the findings, those that change the answer first."""
        made = [
            replace(finding, where=places[0] + (f" and {len(places) - 1} more" if len(places) > 1 else ""))
            for finding, places in self._places.items()
        ]
        return tuple(sorted(made, key=lambda finding: not finding.changes))


@dataclass(eq=False)
class Terms:
    """Linear equations between displacements."""

    equation: list[int] = field(default_factory=list)  # number of the equation of each term, from 0
    terms: list[Term] = field(default_factory=list)
    where: list[str] = field(default_factory=list)  # place of each equation in the file
    is_support: list[bool] = field(default_factory=list)  # of each equation, as in ``Equations``
    points: list[str] = field(default_factory=list)  # names of the connected points in terms

    def point(self, name: str) -> int:
        """Return the index that represents a connected point in terms, in place of a node."""
        if name not in self.points:
            self.points.append(name)
        return -1 - self.points.index(name)

    def add(self, terms: Iterable[Term], where: str, is_support: bool = False) -> None:
        """Add an equation without its terms of coefficient 0."""
        terms = [term for term in terms if term[2] != 0.0]
        if terms:
            self.equation += [len(self.where)] * len(terms)
            self.terms += terms
            self.where.append(where)
            self.is_support.append(is_support)

    def follow_rigidly(self, follower: str, leader: str, arm: np.ndarray, where: str) -> None:
        """Let a point follow another as a rigid body: u = u_l + theta_l x r, theta = theta_l; ``arm`` r (3,)."""
        follows, leads = self.point(follower), self.point(leader)
        x, y, z = arm.tolist()
        turned = ((4, -z), (5, y)), ((5, -x), (3, z)), ((3, -y), (4, x))  # minus theta_l x r
        for axis, terms in enumerate(turned):
            self.add([(follows, axis, 1.0), (leads, axis, -1.0), *((leads, i, value) for i, value in terms)], where)
        for axis in (3, 4, 5):
            self.add([(follows, axis, 1.0), (leads, axis, -1.0)], where)

    def equations(self) -> Equations | None:
        """Return the equations, or None if there are none."""
        if not self.where:
            return None
        nodes, axes, coefficients = zip(*self.terms, strict=True)
        return Equations(
            np.array(self.equation, dtype=np.int64),
            np.array(nodes, dtype=np.int64),
            np.array(axes, dtype=np.int64),
            np.array(coefficients, dtype=float),
            tuple(self.where),
            np.array(self.is_support, dtype=bool),
            tuple(self.points),
        )


@dataclass(eq=False)
class Draft:
    """A structure in the numbering of its file; nodes are referred to by their positions in ``numbers``."""

    numbers: np.ndarray  # (n,) node numbers of the file
    points: np.ndarray  # (n, 3)
    node: str = "node"  # the word for a node in the file's program, for messages
    groups: dict[str, Group] = field(default_factory=dict)
    findings: Findings = field(default_factory=Findings)
    terms: Terms = field(default_factory=Terms)
    supports: list[Support] = field(default_factory=list)
    leaders: dict[int, Point] = field(default_factory=dict)  # by the node that leads others
    masses: list[Mass] = field(default_factory=list)
    springs: list[Spring] = field(default_factory=list)
    of_solids: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))  # (n,) whether a node is part of a solid

    def axes(self, node: int) -> np.ndarray | None:
        """Return the axes of a node's displacements, (3, 3) rows; None for the axes of the model."""
        return None

    def find(self, numbers: Iterable[int], where: str) -> np.ndarray:
        """Return the positions of nodes.  Raises MeshError: the file has no node of a number."""
        wanted = np.array([number for number in numbers if number], dtype=np.int64)
        index, missing = index_of(self.numbers, wanted)
        if len(missing):
            raise MeshError(f"{where} names {self.node} {missing[0]}, which the file does not hold")
        return index

    def mark_solids(self, cells: Iterable[Cells]) -> None:
        """Mark the nodes that belong to solid elements."""
        self.of_solids = np.zeros(len(self.numbers), dtype=bool)
        for block in cells:
            self.of_solids[block.nodes] |= KINDS[block.kind][0] == 3

    def group(self, name: str, nodes: Sequence[int] | np.ndarray) -> str:
        """Add nodes to a group, and return its name."""
        self.groups.setdefault(name, Group()).add_nodes(np.asarray(nodes, dtype=np.int64))
        return name

    def lead(self, name: str, node: int, nodes: np.ndarray, connection: str = "rigid") -> None:
        """Create a point at a node that other nodes follow; in a rigid body a node of a solid also follows its own point."""
        nodes = np.setdiff1d(nodes, [node])
        if connection == "rigid" and self.of_solids[node]:
            nodes = np.union1d(nodes, [node])
        position = vector(self.points[node])
        self.leaders[node] = Point.of_file(name=name, position=position, group=self.group(name, nodes), connection=connection)

    def weigh(self, node: int, nodes: np.ndarray, weights: Sequence[float] | np.ndarray) -> None:
        """State the weights of the nodes of solids that the point at a leading node follows by their mean."""
        of_solids = self.of_solids[nodes] & (nodes != node)
        stated = weights_in_order(self.numbers[nodes[of_solids]], np.asarray(weights)[of_solids])
        self.leaders[node] = self.leaders[node].with_keys(weights=stated)

    def model(self, cells: Iterable[Cells], **further: Any) -> FileModel:
        """Return the content of a file: this structure, its cells and ``further`` fields."""
        return FileModel(
            self.points,
            self.numbers,
            tuple(cells),
            self.groups,
            supports=tuple(self.supports),
            connected=tuple(self.leaders.values()),
            masses=tuple(self.masses),
            springs=tuple(self.springs),
            equations=self.terms.equations(),
            findings=self.findings.all(),
            **further,
        )

    def chain(self, word: str) -> None:
        """Couple a leading node that belongs to another rigid body ``word`` to that body, by equations between their points.

        A body of leading nodes alone is a point without nodes of its own.
        """
        follows: dict[int, list[int]] = {}
        for node, point in self.leaders.items():
            nodes = self.groups[point.group].nodes
            followers = [n for n in nodes.tolist() if n in self.leaders and n != node and not self.of_solids[n]]
            if not followers or point.connection != "rigid":
                continue
            follows[node] = followers
            self.groups[point.group].nodes = np.setdiff1d(nodes, followers)
        with_nodes = {
            node: point.group for node, point in self.leaders.items() if self.of_solids[self.groups[point.group].nodes].any()
        }
        for node, followers in follows.items():
            point = self.leaders[node]
            group = group_below(node, follows, with_nodes)
            if group is None:
                effect = "a rigid body of nodes that lead others, and none of these leads a node of a solid"
                self.findings.add(word, point.name or "", effect, part="points")
                continue
            if group != point.group:
                self.leaders[node] = point.with_keys(group=group, connection="equations")
            for other in followers:
                arm = self.points[other] - self.points[node]
                self.terms.follow_rigidly(self.leaders[other].name, point.name, arm, f"{point.name}, which leads another")

    def add_mass(self, word: str, where: str, node: int, mass: float, inertia: Sequence[float]) -> None:
        """Add a mass to the point of a leading node, with its inertia (xx, yy, zz, xy, yz, zx); otherwise to the node alone."""
        point = self.leaders.get(node)
        if point is None:
            if any(inertia):
                self.findings.add(word, where, "the rotary inertia of a point mass at the node of a solid", part="masses")
            name = where if where.startswith(word) else f"{word} {where}"
            self.masses.append(Mass.of_file(group=self.group(name, [node]), mass=mass))
            return
        total = tuple(a + b for a, b in zip(point.inertia or (0.0,) * len(inertia), inertia, strict=True))
        self.leaders[node] = point.with_keys(mass=point.mass + mass, inertia=total if any(total) else None)

    def hold(self, word: str, fixed: np.ndarray) -> None:
        """Add the supports of the command or card ``word``: held degrees of freedom (n, 6) bool, in the axes of the nodes.

        Leading nodes are supported as points; supports in turned axes become equations; others become groups "D x", "D xy", ...
        """
        for node in [node for node in self.leaders if fixed[node].any()]:
            parts = fixed[node, :3], fixed[node, 3:]
            if self.axes(node) is not None and any(part.any() and not part.all() for part in parts):
                effect = "a support in turned axes of a node that leads a rigid body"
                self.findings.add(word, f"{self.node} {self.numbers[node]}", effect, part="supports")
            else:
                fix = tuple(NAMES[i] for i in np.flatnonzero(fixed[node]))
                self.supports.append(Support.of_file(point=self.leaders[node].name, fix=fix))
        fixed = fixed[:, :3].copy()
        fixed[list(self.leaders)] = False
        for node in np.flatnonzero(fixed.any(axis=1) & ~fixed.all(axis=1)).tolist():
            axes = self.axes(node)
            if axes is not None:
                where = f"{word} of {self.node} {self.numbers[node]} in turned axes"
                for row in axes[fixed[node]]:
                    self.terms.add([(node, axis, float(row[axis])) for axis in range(3)], where, is_support=True)
                fixed[node] = False
        for directions, nodes in fixed_alike(fixed):
            fix = tuple(NAMES[axis] for axis in directions)
            self.supports.append(Support.of_file(group=self.group(f"{word} {''.join(fix)}", nodes), fix=fix))

    def is_point(self, node: int) -> bool:
        """Return whether a node leads other nodes and belongs to no solid."""
        return node in self.leaders and not bool(self.of_solids[node])

    def add_equation(self, word: str, where: str, terms: list[Term]) -> None:
        """Add an equation in the axes of the nodes; leading nodes outside solids are points, which also have rotations."""
        made: list[Term] = []
        for node, axis, value in terms:
            axes, (turns, along), is_point = self.axes(node), divmod(axis, 3), self.is_point(node)
            if turns and not is_point:
                effect = "an equation with a rotation of a node that leads no others, or is of a solid"
                self.findings.add(word, where, effect, part="equations")
                return
            row = np.eye(3)[along] if axes is None else axes[along]
            at = self.terms.point(self.leaders[node].name) if is_point else node
            made += [(at, i + 3 * turns, float(value * row[i])) for i in range(3)]
        self.terms.add(made, where if where.startswith(word) else f"{word}, {where}")


def group_below(node: int, follows: Mapping[int, Sequence[int]], groups: Mapping[int, str]) -> str | None:
    """Return the group of nodes of a leading node, or of the nearest one that follows it; None if there is none.  Local.

    ``follows`` are the leading nodes that follow a leading node, ``groups`` those of the leading nodes with nodes of their own.
    """
    reached = [node]
    for at in reached:  # grows while it is read
        if at in groups:
            return groups[at]
        reached += [other for other in follows.get(at, ()) if other not in reached]
    return None


def grounded(point: Point, component: int, stiffness: float) -> Point:
    """Return a point with a spring to ground along axis 1 to 3, or about it (component 4 to 6).  Local."""
    key = "stiffness" if component <= 3 else "rotational_stiffness"
    values = list(getattr(point, key) or (0.0, 0.0, 0.0))
    values[(component - 1) % 3] += stiffness
    return point.with_keys(**{key: vector(values)})


def cells_of(kind: str, cells: np.ndarray, nodes: np.ndarray, numbers: np.ndarray, node: str = "node") -> Cells:
    """Return elements as cells, from their node numbers (n, n_nodes) and all node numbers of the file.  Local.

    Raises
    ------
    MeshError : the file does not have a node of an element
    """
    index, missing = index_of(numbers, nodes)
    if len(missing):
        element = cells[np.isin(nodes, missing).any(axis=1)][0]
        raise MeshError(f"element {element} names {node} {missing[0]}, which the file does not hold")
    return Cells(kind, index, cells)


def face_of(kind: str, corners: Iterable[int]) -> tuple[str, np.ndarray] | None:
    """Return kind and local nodes of the face of a solid with these corners; None if ``kind`` is not a solid here.  Local."""
    for face, nodes in elements.KINDS[kind].faces if kind in elements.KINDS else ():
        if set(nodes[: 3 if face.startswith("tri") else 4].tolist()) == set(corners):
            return face, nodes
    return None
