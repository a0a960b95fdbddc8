"""What a structure with a mesh is made of, as plain values in SI units: its file, and what the groups in it are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..elements import Material, Solids

Vector = tuple[float, float, float]
GEOMETRY = "geometry"  # the gap of a joint: what the mesh has
MORTAR = "mortar"  # the pairing of moments over faces
UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s2", "stress": "Pa", "strain": "1", "contact_force": "N"}


@dataclass(frozen=True, kw_only=True)
class Body:
    """A group of volume elements of one linear elastic material."""

    group: str
    material: Material
    density: float  # kg/m3
    integration: str = "full"  # "full", "reduced", "reduced-both"
    incompatible_modes: bool = True  # in 8-node hexahedra

    def solids(self, kind: str, points: np.ndarray, warmer: float | np.ndarray = 0.0) -> Solids:
        """Return elements of the body, whose nodes are at ``points`` (n_elements, n, 3) [m], so much warmer [K].  Local."""
        return Solids(kind, points, self.material, self.integration, self.incompatible_modes, warmer)


@dataclass(frozen=True, kw_only=True)
class Support:
    """A group of nodes, or a point, that is held."""

    group: str | None = None
    point: str | None = None
    fix: tuple[str, ...]  # of "x", "y", "z"; of a point "rx", "ry", "rz", too


@dataclass(frozen=True, kw_only=True)
class TouchingFaces:
    """A group of faces told by what they lie on: those of one body that touch another."""

    name: str
    bodies: tuple[str, str]  # names; the same twice: parts of a body that touch each other
    normal: Vector | None = None  # of the faces, outward, roughly; None: all of them
    tolerance: float | None = None  # m, how far apart; None: by the size of the faces


@dataclass(frozen=True, kw_only=True)
class Tie:
    """Two surfaces glued: the nodes of the first follow the facets of the second."""

    name: str
    surfaces: tuple[str, str]  # groups
    tolerance: float | None = None  # m, from node to facet; None: by the size of the facets


@dataclass(frozen=True, kw_only=True)
class Point:
    """A point connected to the nodes of a group, with three displacements and three small rotations."""

    name: str
    position: Vector  # m
    group: str
    rigid: bool = True  # the nodes follow the point as a rigid body; otherwise the point follows their weighted mean
    by_area: bool = True  # of that mean: weights are tributary areas where the group has faces; otherwise all alike
    mass: float = 0.0  # kg
    inertia: tuple[float, ...] = (0.0,) * 6  # kg m2 about the point: xx, yy, zz, xy, yz, zx
    stiffness: Vector = (0.0, 0.0, 0.0)  # N/m, springs to ground
    rotational_stiffness: Vector = (0.0, 0.0, 0.0)  # N m/rad

    @property
    def is_sprung(self) -> bool:
        return any(self.stiffness) or any(self.rotational_stiffness)


@dataclass(frozen=True, kw_only=True)
class Mass:
    """A point mass at each node of a group, or at a point."""

    group: str | None = None
    point: str | None = None
    mass: float  # kg


@dataclass(frozen=True, kw_only=True)
class Spring:
    """A spring and a damper along a direction: of each node of a group to ground, or between two single nodes or points."""

    groups: tuple[str, ...] = ()
    points: tuple[str, ...] = ()
    direction: Vector | None = None  # None: along the line between the two nodes
    stiffness: float = 0.0  # N/m
    damping: float = 0.0  # N s/m


@dataclass(frozen=True, kw_only=True)
class GroundPlane:
    """The surface of rigid ground."""

    point: Vector  # m
    normal: Vector  # out of the ground


@dataclass(frozen=True, kw_only=True)
class Joint:
    """Two surfaces in contact, or one on rigid ground."""

    name: str
    surfaces: tuple[str, ...]  # groups, of body 1 and body 2; of body 1 alone on ground
    plane: GroundPlane | None = None  # of the ground; None: it has the shape of the surface
    pairing: str = "auto"  # "nodes" that match, "points", "mortar" or "projected" nodes of any meshes, or "auto"
    friction: float  # -
    tangential_stiffness: float  # N/m3
    normal_stiffness: float  # N/m3
    preload: float = 0.0  # Pa, before the statics
    gap: float | str = 0.0  # m, or GEOMETRY
    separate: bool = False  # each tangential direction has its own friction limit
    tolerance: float | None = None  # m, between nodes of a pair or the surfaces; None: by the size of the mesh
    tangent: Vector | None = None  # whose projection is x of the pairs; None: a model axis
    parameters: Path | None = None  # a file of values for each contact point
    fields: Mapping[str, str] = field(default_factory=dict)  # names of values: fields of the mesh that have them
    node_pairs: Path | None = None  # a file that lists the pairs, in place of surfaces
    law: str = "elastic-coulomb"  # of contact/laws.py
    keys: Mapping[str, Any] = field(default_factory=dict)  # of the law, beside those above


@dataclass(frozen=True, kw_only=True)
class Load:
    """What every level multiplies: a force at nodes of a mesh or at a DOF of matrices, a pressure, forces from a file.

    A load whose phase varies over the structure is two real shapes, a quarter of a cycle apart: docs/theory.md, section 13.
    """

    position: Vector | None = None  # m
    node: int | None = None
    group: str | None = None
    point: str | None = None
    direction: Vector | None = None
    moment: Vector | None = None  # at a point, in place of the direction
    dof: int | None = None
    scale: float = 1.0  # of a load on a dof
    pressure: float | None = None  # Pa, on a group of faces
    travelling: Vector | None = None  # rad/m: how the phase of the pressure changes along x, y, z
    engine_order: int | None = None  # how often it turns once about the axis
    axis: Vector = (0.0, 0.0, 1.0)  # direction of that axis
    axis_point: Vector = (0.0, 0.0, 0.0)  # m
    forces: Path | None = None  # a CSV file of forces
    base_acceleration: Vector | None = None  # m/s2, of the supports
    harmonic: int = 1
    phase: float = 0.0  # rad

    @property
    def phases(self) -> tuple[float, ...]:
        """The phase of each of its real shapes [rad]: of the real part and, where there may be one, of the imaginary part."""
        varies = self.travelling is not None or self.engine_order is not None or self.forces is not None
        return (self.phase, self.phase + 0.5 * np.pi) if varies else (self.phase,)

    @property
    def unit(self) -> str:
        """What a level of this load counts; "1" where the load itself has a unit."""
        if self.base_acceleration is not None:
            return "m/s2"
        return "1" if self.pressure is not None or self.forces is not None else "N"


@dataclass(frozen=True, kw_only=True)
class Output:
    """The displacement of a node or point, or of a DOF; a rotation; derivatives of them; stress, strain; a contact force."""

    name: str
    position: Vector | None = None  # m
    node: int | None = None
    point: str | None = None
    direction: Vector | None = None
    rotation: Vector | None = None  # of a point about this direction, in place of a displacement
    dof: int | None = None
    quantity: str = "displacement"  # a key of UNITS
    component: str | None = None  # of stress and strain "xx", ..., "zx"; "normal" of a contact force
    body: str | None = None  # whose stress
    joint: str | None = None  # whose contact force
    absolute: bool = False  # with the motion of the base

    @property
    def unit(self) -> str:
        return UNITS[self.quantity] if self.rotation is None else UNITS[self.quantity].replace("m", "rad")

    @property
    def order(self) -> int:
        """How often it is the derivative of a displacement by time."""
        return ("velocity", "acceleration").index(self.quantity) + 1 if self.quantity in ("velocity", "acceleration") else 0


@dataclass(frozen=True, kw_only=True)
class Force:
    """A constant force at nodes of a mesh, or a moment."""

    position: Vector | None = None  # m
    node: int | None = None
    group: str | None = None
    point: str | None = None
    force: Vector | None = None  # N, of all its nodes together
    moment: Vector | None = None  # N m, of all nodes of a group together, or of a point


@dataclass(frozen=True, kw_only=True)
class Warm:
    """Temperatures at the nodes of a body, K above that without stress: a field of the mesh, or a file."""

    field: str | None = None
    file: Path | None = None  # columns node, temperature


@dataclass(frozen=True, kw_only=True)
class Bolt:
    """A shank that is cut and pulled together: by a force, or by a length."""

    name: str
    group: str  # faces of the cut
    force: float | None = None  # N, while it is tightened
    shortening: float | None = None  # m


@dataclass(frozen=True, kw_only=True)
class Statics:
    """What acts before the structure vibrates."""

    speed: float = 0.0  # rad/s, of rotation
    axis: Vector = (0.0, 0.0, 1.0)  # its direction
    axis_point: Vector = (0.0, 0.0, 0.0)  # m
    forces: tuple[Force, ...] = ()
    pressures: tuple[tuple[str, float], ...] = ()  # group of faces, Pa
    temperatures: Mapping[str, float | Warm] = field(default_factory=dict)  # by body, K above that without stress
    bolts: tuple[Bolt, ...] = ()
    displacements: tuple[tuple[str, Vector], ...] = ()  # group of supported nodes, m
    steps: int = 10
    stiffens: bool = True  # the vibration feels stress and spin
    deforms: bool = False  # and the change of shape
    is_large: bool = False  # displacements are large: strains and equilibrium of the deformed shape

    @property
    def spin(self) -> np.ndarray:
        """Omega^2 (1 - a a^T), (3, 3) [1/s2]: acceleration per distance from the axis."""
        a = np.asarray(self.axis, dtype=float)
        a = a / np.linalg.norm(a)
        return self.speed**2 * (np.eye(3) - np.outer(a, a))


@dataclass(frozen=True, kw_only=True)
class MeshSettings:
    """A structure with a mesh."""

    file: Path
    stated: str = ""  # the file as the user names it, for messages
    scale: float = 1.0  # m per unit of the file
    bodies: Mapping[str, Body]  # by name
    supports: tuple[Support, ...] = ()
    surfaces: tuple[TouchingFaces, ...] = ()
    joints: tuple[Joint, ...] = ()
    ties: tuple[Tie, ...] = ()
    points: tuple[Point, ...] = ()
    masses: tuple[Mass, ...] = ()
    springs: tuple[Spring, ...] = ()
    has_equations: bool = False  # those of the file hold
    loads: tuple[Load, ...] = ()
    outputs: tuple[Output, ...] = ()
    statics: Statics | None = None

    @property
    def attached(self) -> list[tuple[str, str]]:
        """The groups of masses and springs, each after the key that names it; their nodes may belong to no element."""
        named = [(f"[[masses]] {i} group", mass.group) for i, mass in enumerate(self.masses, 1) if mass.group is not None]
        return named + [(f"[[springs]] {i} groups", group) for i, one in enumerate(self.springs, 1) for group in one.groups]

    @property
    def body_of(self) -> dict[str, str]:
        """The body of each group of volume elements."""
        return {body.group: name for name, body in self.bodies.items()}

    @property
    def groups_on_bodies(self) -> list[tuple[str, str]]:
        """The groups of supports, joints, ties, points and loads, each after the key that names it."""
        supports = [(i, support.group) for i, support in enumerate(self.supports, 1)]
        named = [(f"[[supports]] {i} group", group) for i, group in supports if group is not None]
        named += [(f"[[joints]] {joint.name!r} surfaces", group) for joint in self.joints for group in joint.surfaces]
        named += [(f"[[ties]] {tie.name!r} surfaces", group) for tie in self.ties for group in tie.surfaces]
        named += [(f"[[points]] {point.name!r} group", point.group) for point in self.points]
        named += [(f"[[loads]] {i} group", load.group) for i, load in enumerate(self.loads, 1) if load.group is not None]
        if self.statics is not None:
            forces, pressures = self.statics.forces, self.statics.pressures
            named += [(f"[[statics.forces]] {i} group", one.group) for i, one in enumerate(forces, 1) if one.group is not None]
            named += [(f"[[statics.pressures]] {i} group", group) for i, (group, _) in enumerate(pressures, 1)]
            named += [(f"[[statics.bolts]] {i} group", bolt.group) for i, bolt in enumerate(self.statics.bolts, 1)]
            named += [
                (f"[[statics.displacements]] {i} group", group) for i, (group, _) in enumerate(self.statics.displacements, 1)
            ]
        return named
