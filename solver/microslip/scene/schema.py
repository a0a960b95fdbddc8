"""The keys of a scene file: one frozen model a table.

Every key's description says what is expected of it, with its unit; messages quote it (messages.py).
"""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, PrivateAttr, field_validator, model_validator

from ..parallel.words import listed
from .joint_laws import LAWS_OF_KEY, NEEDED, NEEDED_WITH_PAIRS, OF_FILE, check_law

WHOLE_MODELS = (
    ".inp",
    ".cdb",
    ".rst",
    ".bdf",
    ".nas",
    ".fem",
    ".op2",
    ".dat",
    ".e",
    ".exo",
    ".ex2",
    ".unv",
)  # endings of files that may state more than a mesh
HIGHEST_FREQUENCY = 1e9  # Hz: beyond it a frequency is a slip of the pen
LARGEST_NUMBER = 2**62  # of nodes and DOFs
_PARALLEL = 1e-6  # sine of the angle between directions that span no plane
DEFAULT_ACCURACY = 1e-3
DEFAULT_INTERFACE_MODES = 40  # all there are where the joint has fewer

Method = Literal[
    "adaptive", "adaptive-energy", "receptance", "full", "craig-bampton", "rubin", "joint-interface-modes", "trial-vectors"
]
Axis = Literal["x", "y", "z", "rx", "ry", "rz"]
OfPoints = Literal["friction", "tangential_stiffness", "normal_stiffness", "preload", "gap"]
OF_SURFACES = (
    "preload",
    "gap",
    "tolerance",
    "against",
    "plane_point",
    "plane_normal",
    "pairing",
    "tangent",
    "parameters",
    "fields",
)
Units = Literal["m-kg-s", "mm-t-s", "mm-kg-s", "mm-kg-ms", "in-lbf-s"]
UNITS: tuple[str, ...] = get_args(Units)
Taken = Literal["materials", "bodies", "supports", "ties", "joints", "points", "masses", "springs", "equations", "statics"]
TAKEN: tuple[Taken, ...] = get_args(Taken)
Quantity = Literal["displacement", "velocity", "acceleration", "stress", "strain", "contact_force"]
Component = Literal["xx", "yy", "zz", "xy", "yz", "zx", "normal"]


def _listed(words: tuple[str, ...], last: str = "or") -> str:
    """Return '"a", "b" or "c"'."""
    return listed([f'"{word}"' for word in words], last)


def _not_zero(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    if not any(vector):
        raise ValueError("zero vector")
    return vector


def _number_not_zero(value: float) -> float:
    if value == 0.0:
        raise ValueError("zero")
    return value


def _no_duplicates(values: tuple) -> tuple:
    if len(set(values)) < len(values):
        raise ValueError("an entry twice")
    return values


def _rising(limits: tuple[float, float]) -> tuple[float, float]:
    if not limits[0] < limits[1]:
        raise ValueError("not rising")
    return limits


Name = Annotated[str, Field(pattern=r'^[^\s,"/\\\x00-\x1f](?:[^,"/\\\x00-\x1f]*[^\s,"/\\\x00-\x1f])?$')]
Positive = Annotated[float, Field(gt=0)]
TwoPositive = tuple[Positive, Positive]
ThreePositive = tuple[Positive, Positive, Positive]
Six = tuple[float, float, float, float, float, float]
NotNegative = Annotated[float, Field(ge=0)]
Ratio = Annotated[float, Field(ge=0, lt=1)]
ModeNumber = Annotated[int, Field(ge=1, le=LARGEST_NUMBER)]
NotZero = Annotated[float, AfterValidator(_number_not_zero)]
Frequency = Annotated[float, Field(gt=0, le=HIGHEST_FREQUENCY)]
Number = Annotated[int, Field(ge=0, le=LARGEST_NUMBER)]
Vector = tuple[float, float, float]
Direction = Annotated[Vector, AfterValidator(_not_zero)]


class Table(BaseModel):
    """A table of the scene: no other keys, no conversions, no NaN, not to be changed."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    def exactly_one(self, *keys: str) -> str:
        """Return the one key of ``keys`` that is given; ValueError if it is none or several."""
        given = [key for key in keys if getattr(self, key) is not None]
        if len(given) != 1:
            raise ValueError(f"exactly one of {', '.join(keys)} is needed, found {' and '.join(given) or 'none'}")
        return given[0]


class Model(Table):
    """[model]: a mesh, or matrices of another program."""

    mesh: str | None = Field(None, min_length=1, description="the path of the mesh file, relative to the scene's folder")
    scale: Positive = Field(1.0, description="metres per unit of the mesh, a number above 0")
    units: Units | None = Field(None, description=f"the units of the model file, {_listed(UNITS)}")
    take: Annotated[tuple[Taken, ...], AfterValidator(_no_duplicates)] = Field(
        TAKEN, description=f"what is taken over from the model file, a list of {_listed(TAKEN, 'and')}, each once"
    )
    ignore: Annotated[tuple[str, ...], AfterValidator(_no_duplicates)] = Field(
        (), description='what the model file holds and is to be left out, a list of its words as "*CONTACT PAIR", each once'
    )
    stiffness: str | None = Field(None, min_length=1, description="the path of the stiffness matrix")
    mass: str | None = Field(None, min_length=1, description="the path of the mass matrix")
    damping: str | None = Field(None, min_length=1, description="the path of the damping matrix")
    dofs: str | None = Field(None, min_length=1, description="the path of a CSV file with node and direction of each row")
    nodes: str | None = Field(
        None, min_length=1, description="the path of a CSV file with node,x,y,z in m, or of a mesh file in metres"
    )
    recovery: str | None = Field(None, min_length=1, description="the path of the recovery matrix of a superelement")
    recovery_dofs: str | None = Field(
        None, min_length=1, description="the path of a CSV file with node and direction of each row of the recovery matrix"
    )
    axis: Direction | None = Field(None, description="the direction of the axis of rotation, three numbers [x, y, z], not all 0")
    axis_point: Vector = Field((0.0, 0.0, 0.0), description="a point of the axis of rotation, three coordinates [x, y, z] in m")

    @model_validator(mode="after")
    def _mesh_or_matrices(self):
        if self.exactly_one("mesh", "stiffness") == "mesh":
            for key in ("mass", "damping", "dofs", "nodes", "recovery", "recovery_dofs"):
                if getattr(self, key) is not None:
                    raise ValueError(f"{key} belongs to a model given as matrices; this one has a mesh")
            if self.units is not None and "scale" in self.model_fields_set:
                raise ValueError("scale belongs to a mesh without units; units states the length already")
        elif self.mass is None:
            raise ValueError("mass is missing: a model given as matrices needs stiffness and mass")
        elif self.recovery is None and self.recovery_dofs is not None:
            raise ValueError("recovery_dofs names the rows of a recovery matrix, and recovery is missing")
        for key in ("scale", "units", "take", "ignore"):
            if self.mesh is None and key in self.model_fields_set:
                raise ValueError(f"{key} belongs to a mesh; matrices are taken in SI units, as they are")
        return self


class Material(Table):
    """[materials.NAME]: linear elastic, isotropic or with values along axes of its own."""

    young: Positive | ThreePositive | None = Field(
        None, description="Young's modulus in Pa, a number above 0, or three along the axes of the material"
    )
    poisson: Annotated[float, Field(gt=-1, lt=0.5)] | Vector | None = Field(
        None, description="Poisson's ratio, a number above -1 and below 0.5, or three: of axes 1 and 2, 1 and 3, 2 and 3"
    )
    shear: ThreePositive | None = Field(
        None, description="three shear moduli in Pa, numbers above 0, of axes 1 and 2, 1 and 3, 2 and 3"
    )
    elasticity: tuple[Six, Six, Six, Six, Six, Six] | None = Field(
        None, description="six rows of six numbers in Pa, symmetric, in the order 11, 22, 33, 12, 13, 23"
    )
    density: Positive = Field(description="the density in kg/m3, a number above 0")
    expansion: float | Vector | None = Field(
        None, description="the coefficient of thermal expansion in 1/K, a number, or three along the axes of the material"
    )

    @model_validator(mode="after")
    def _elastic(self):
        if self.elasticity is not None:
            for key in ("young", "poisson", "shear"):
                if getattr(self, key) is not None:
                    raise ValueError(f"{key} beside elasticity, which says all of it; keep one of them")
        else:
            for key in ("young", "poisson"):
                if getattr(self, key) is None:
                    raise ValueError(f"{key} is missing: expected {Material.model_fields[key].description}")
        if len({isinstance(self.young, tuple), isinstance(self.poisson, tuple), self.shear is not None}) > 1:
            raise ValueError(
                "an orthotropic material has three numbers each of young, poisson and shear; an isotropic one no shear"
            )
        if isinstance(self.expansion, tuple) and not self.has_axes:
            raise ValueError("expansion holds three numbers, and the material is isotropic: expected one number in 1/K")
        return self

    @property
    def has_axes(self) -> bool:
        """Whether it differs by direction."""
        return self.elasticity is not None or isinstance(self.young, tuple)


class Orientation(Table):
    """[orientations.NAME]: the axes of a material."""

    directions: tuple[Direction, Direction] | None = Field(
        None, description="two directions [[x, y, z], [x, y, z]]: axis 1, and another in the plane of axes 1 and 2"
    )
    axis: Direction | None = Field(
        None, description="the direction [x, y, z] of axis 3, around which axis 1 is radial and axis 2 tangential"
    )
    axis_point: Vector = Field((0.0, 0.0, 0.0), description="a point of that axis, three coordinates [x, y, z] in m")

    @model_validator(mode="after")
    def _one_kind(self):
        if self.exactly_one("directions", "axis") == "directions" and "axis_point" in self.model_fields_set:
            raise ValueError("axis_point belongs to axis; directions are the same everywhere")
        if self.directions is not None:
            (a, b, c), (x, y, z) = self.directions
            across = math.hypot(b * z - c * y, c * x - a * z, a * y - b * x)
            if across <= _PARALLEL * math.hypot(a, b, c) * math.hypot(x, y, z):
                raise ValueError("directions are parallel; they span no plane")
        return self


class Body(Table):
    """[bodies.NAME]: which elements are what."""

    group: str = Field(min_length=1, description="the name of a group of volume elements in the mesh")
    material: str = Field(min_length=1, description="the NAME of a table [materials.NAME]")
    integration: Literal["full", "reduced", "reduced-both"] = Field(
        "full", description='the quadrature, "full", "reduced" or "reduced-both"'
    )
    incompatible_modes: bool = Field(True, description="true or false: incompatible modes in 8-node hexahedra")
    orientation: str | None = Field(
        None, min_length=1, description="the NAME of a table [orientations.NAME]; without it axes of the material are the model's"
    )


class Support(Table):
    """[[supports]]: a group of nodes, or a point, that is held."""

    group: str | None = Field(None, min_length=1, description="the name of a group in the mesh")
    point: str | None = Field(None, min_length=1, description="the name of one of the [[points]]")
    fix: Annotated[tuple[Axis, ...], AfterValidator(_no_duplicates)] = Field(
        min_length=1,
        description='the fixed directions, a list of "x", "y" and "z", of a point "rx", "ry" and "rz", too, each once',
    )

    @model_validator(mode="after")
    def _place(self):
        if self.group is None and self.point is None:
            raise ValueError(f"group is missing: expected {Support.model_fields['group'].description}")
        self.exactly_one("group", "point")
        turns = [axis for axis in self.fix if axis not in "xyz"]
        if self.group is not None and turns:
            raise ValueError(f'fix holds "{turns[0]}": the nodes of a group have no rotation; a point has')
        return self


class Surface(Table):
    """[[surfaces]]: a group of faces told by the bodies that touch."""

    name: Name = Field(description="a name that joints, ties and others use as that of a group, without comma, quote or slash")
    bodies: tuple[str, str] = Field(
        description="the NAMEs of two tables [bodies.NAME]: faces of the first that lie on the second; or one twice"
    )
    normal: Direction | None = Field(
        None, description="the direction [x, y, z], out of the first body, in which the faces look, three numbers, not all 0"
    )
    tolerance: Positive | None = Field(None, description="how far apart in m the faces of the two may lie, a number above 0")

    @model_validator(mode="after")
    def _one_side(self):
        if self.bodies[0] == self.bodies[1] and self.normal is None:
            raise ValueError(
                f'normal is missing, which tells one side of the parts of "{self.bodies[0]}" from the other: expected '
                f"{Surface.model_fields['normal'].description}"
            )
        return self


class Tie(Table):
    """[[ties]]: two surfaces glued."""

    name: Name | None = Field(None, description="a name for messages, without comma, quote or slash")
    surfaces: tuple[str, str] = Field(
        description="the names of two different groups of faces; the nodes of the first follow the facets of the second"
    )
    tolerance: Positive | None = Field(
        None, description="the farthest distance in m of a node of the first surface from the second, a number above 0"
    )

    @field_validator("surfaces")
    @classmethod
    def _two_surfaces(cls, surfaces):
        if surfaces[0] == surfaces[1] or not all(surfaces):
            raise ValueError("one surface twice")
        return surfaces


class Point(Table):
    """[[points]]: a point connected to a group of nodes."""

    name: Name = Field(description="a name that loads, supports and outputs use, without comma, quote or slash")
    position: Vector = Field(description="three coordinates [x, y, z] in m")
    group: str = Field(min_length=1, description="the name of a group in the mesh")
    connection: Literal["rigid", "distributing"] = Field(
        "rigid", description='"rigid": the nodes follow the point; or "distributing": it follows their mean'
    )
    weights: Literal["area", "equal"] = Field(
        "area", description='the weights of that mean, "area" of each node, or "equal" for all of them'
    )
    mass: NotNegative = Field(0.0, description="the mass in kg, a number of at least 0")
    inertia: tuple[NotNegative, NotNegative, NotNegative] | tuple[float, float, float, float, float, float] | None = Field(
        None,
        description="the moments of inertia about the point in kg m2, [xx, yy, zz] or [xx, yy, zz, xy, yz, zx], never below 0",
    )
    stiffness: tuple[NotNegative, NotNegative, NotNegative] | None = Field(
        None, description="the springs to ground along x, y and z in N/m, three numbers of at least 0"
    )
    rotational_stiffness: tuple[NotNegative, NotNegative, NotNegative] | None = Field(
        None, description="the springs to ground about x, y and z in N m/rad, three numbers of at least 0"
    )

    @field_validator("inertia")
    @classmethod
    def _physical(cls, inertia):
        if inertia is None:
            return inertia
        xx, yy, zz, xy, yz, zx = (*inertia, 0.0, 0.0, 0.0)[:6]
        size = xx + yy + zz
        determinant = xx * yy * zz + 2.0 * xy * yz * zx - xx * yz**2 - yy * zx**2 - zz * xy**2
        minors = (xx * yy - xy**2, yy * zz - yz**2, zz * xx - zx**2)
        if min(xx, yy, zz) < 0.0 or min(minors) < -1e-9 * size**2 or determinant < -1e-9 * size**3:
            raise ValueError("an inertia below 0 about some axis")
        return inertia


class Mass(Table):
    """[[masses]]: a point mass at each node of a group."""

    group: str | None = Field(None, min_length=1, description="the name of a group in the mesh")
    point: str | None = Field(None, min_length=1, description="the name of one of the [[points]]")
    mass: NotNegative = Field(description="the mass in kg of each of its nodes, or of the point, a number of at least 0")

    @model_validator(mode="after")
    def _place(self):
        self.exactly_one("group", *["point"] * (self.point is not None))
        return self


class Spring(Table):
    """[[springs]]: nodes on springs and dampers to ground, or two nodes joined by one."""

    groups: Annotated[tuple[str, ...], AfterValidator(_no_duplicates), Field(max_length=2)] = Field(
        (), description="the name of a group whose nodes have springs to ground, or of two groups of one node each, in a list"
    )
    points: Annotated[tuple[str, ...], AfterValidator(_no_duplicates), Field(max_length=2)] = Field(
        (), description="the names of one or two of the [[points]] that it holds, in a list, in place of groups or beside one"
    )
    direction: Direction | None = Field(
        None,
        description="the direction [x, y, z] in which it acts, three numbers, not all 0; between two nodes by default their line",
    )
    stiffness: NotNegative = Field(0.0, description="the stiffness in N/m, a number of at least 0")
    damping: NotNegative = Field(0.0, description="the damping constant in N s/m, a number of at least 0")

    @model_validator(mode="after")
    def _directed(self):
        if not {"stiffness", "damping"} & self.model_fields_set:
            raise ValueError(f"stiffness is missing: expected {Spring.model_fields['stiffness'].description}; or damping")
        if not self.groups and not self.points:
            raise ValueError(f"groups is missing: expected {Spring.model_fields['groups'].description}; or points")
        if len(self.groups) + len(self.points) > 2:
            raise ValueError("groups and points: a spring has two ends at most")
        if len(self.groups) + len(self.points) == 1 and self.direction is None:
            raise ValueError(f"direction is missing: expected {Spring.model_fields['direction'].description}")
        return self


class Joint(Table):
    """[[joints]]: two surfaces in contact, one on rigid ground, or pairs of DOFs."""

    name: Name = Field(description="a name for pictures and messages, without comma, quote or slash")
    surfaces: Annotated[tuple[str, ...], Field(min_length=1, max_length=2)] | None = Field(
        None, description="the names of two different groups of faces in the mesh, body 1 and body 2; with against, of one"
    )
    against: Literal["ground", "plane"] | None = Field(
        None, description='"ground", rigid and of the shape of the surface, or "plane", rigid and flat'
    )
    plane_point: Vector | None = Field(None, description="a point of the plane, three coordinates [x, y, z] in m")
    plane_normal: Direction | None = Field(
        None, description="the direction [x, y, z] from the plane into the body, three numbers, not all 0"
    )
    pairing: Literal["auto", "nodes", "points", "mortar", "projected"] = Field(
        "auto", description='"nodes" that match, "points", "mortar" or "projected" nodes of any meshes, or "auto"'
    )
    pairs: str | None = Field(None, min_length=1, description="the path of a CSV file of contact pairs")
    node_pairs: str | None = Field(
        None,
        min_length=1,
        description="the path of a CSV file of pairs of nodes with normals and areas, of a model given as matrices",
    )
    law: Literal["elastic-coulomb", "rough", "iwan"] = Field(
        "elastic-coulomb", description='the contact law, "elastic-coulomb", "rough" or "iwan"'
    )
    friction: NotNegative | TwoPositive | None = Field(None, description="the friction coefficient, a number of at least 0")
    tangential_stiffness: Positive | TwoPositive | None = Field(
        None, description="the stiffness per unit area in N/m3, a number above 0"
    )
    normal_stiffness: Positive | None = Field(None, description="the stiffness per unit area in N/m3, a number above 0")
    preload: NotNegative | Literal["static"] | None = Field(
        None, description='the contact pressure at rest in Pa, a number of at least 0 (open ones have a gap), or "static"'
    )
    gap: NotNegative | Literal["geometry"] = Field(
        0.0, description='the distance at rest in m, a number of at least 0, or "geometry": that of the mesh'
    )
    friction_limit: Literal["circle", "separate"] = Field("circle", description='"circle" or "separate"')
    tolerance: Positive | None = Field(
        None, description="the distance in m within which nodes, or parts of the two surfaces, meet, a number above 0"
    )
    tangent: Direction | None = Field(
        None, description="the direction [x, y, z] whose projection on the surface is x of the pairs, three numbers, not all 0"
    )
    parameters: str | None = Field(None, min_length=1, description="the path of a CSV file of values for each contact point")
    fields: dict[OfPoints, str] = Field(
        {},
        description='a table of names of fields of the mesh, as { friction = "mu" }, for friction, preload, gap or a stiffness',
    )
    roughness_height: Positive | None = Field(None, description="the length in m over which the pressure grows, a number above 0")
    roughness_pressure: Positive | None = Field(
        None, description="the pressure in Pa at an approach of roughness_height, a number above 0"
    )
    exponent: float | None = Field(None, gt=1, le=1000, description="the power of the approach, a number above 1, at most 1000")
    tangential_ratio: Positive | None = Field(None, description="the tangential over the normal stiffness, a number above 0")
    slip_force: Positive | None = Field(None, description="the force in N at which all of the joint slips, a number above 0")
    chi: float | None = Field(
        None, gt=-1, le=0, description="the exponent of the sliders' distribution, a number above -1 and at most 0"
    )
    beta: NotNegative | None = Field(
        None, description="the stiffness of the last slider over that of the others, a number of at least 0"
    )
    sliders: int | None = Field(None, ge=2, le=1000, description="the number of elements a pair, a whole number from 2 to 1000")

    @field_validator("surfaces")
    @classmethod
    def _two_surfaces(cls, surfaces):
        if surfaces is not None and (len(set(surfaces)) < len(surfaces) or not all(surfaces)):
            raise ValueError("one surface twice")
        return surfaces

    @model_validator(mode="after")
    def _complete(self):
        has_gap = self.gap != 0.0 or self.against == "plane"
        needed = [*NEEDED[self.law]] + ["preload"] * (not has_gap and self.law in LAWS_OF_KEY["preload"])
        kind = self.exactly_one("surfaces", "pairs", *["node_pairs"] * (self.node_pairs is not None))
        has_pairs = kind == "pairs"
        if has_pairs:
            given = sorted({*OF_FILE, *OF_SURFACES} & self.model_fields_set)
            if given:
                raise ValueError(f"{given[0]} belongs to a joint of surfaces; a CSV file states it for each pair")
        missing = [key for key in (NEEDED_WITH_PAIRS[self.law] if has_pairs else needed) if getattr(self, key) is None]
        if missing:
            more = f"; and {listed(missing[1:])}" if len(missing) > 1 else ""
            raise ValueError(f"{missing[0]} is missing: expected {type(self).model_fields[missing[0]].description}{more}")
        check_law(dict(self), self.model_fields_set)
        if has_pairs:
            return self
        if has_gap and self.preload and self.preload != "static":
            gap = f"gap = {self.gap:g}" if isinstance(self.gap, float) and self.gap else "a gap from the geometry"
            raise ValueError(f"{gap} with preload = {self.preload}: an open joint carries no preload; keep one")
        if kind == "node_pairs":
            self._of_nodes()
        else:
            self._grounded()
        return self

    def _of_nodes(self) -> None:
        """Raise ValueError for keys that find pairs, or that need a mesh: a file lists them."""
        for key in ("against", "plane_point", "plane_normal", "pairing", "tolerance", "fields"):
            if key in self.model_fields_set:
                raise ValueError(f"{key} belongs to a joint of surfaces; node_pairs lists the pairs")
        if self.gap == "geometry" or self.preload == "static":
            raise ValueError("a joint of node_pairs states gap and preload as numbers, or in a file, parameters")

    def _grounded(self) -> None:
        """Raise ValueError unless one surface comes with ground and two without, and a plane with its place."""
        assert self.surfaces is not None, "a joint of surfaces"
        if len(self.surfaces) == 1 and self.against is None:
            raise ValueError('surfaces names one group; name two, or state against = "ground" or "plane"')
        if self.against is not None and self.pairing == "mortar":
            raise ValueError(f'pairing = "mortar" takes two surfaces; with against = "{self.against}" take "nodes" or "points"')
        if len(self.surfaces) == 2 and self.against is not None:
            raise ValueError(f'against = "{self.against}" takes the place of the second surface; name one')
        for key in ("plane_point", "plane_normal"):
            if self.against == "plane" and getattr(self, key) is None:
                raise ValueError(f"{key} is missing: expected {type(self).model_fields[key].description}")
            if self.against != "plane" and getattr(self, key) is not None:
                raise ValueError(f'{key} belongs to against = "plane"')
        if self.against == "plane" and self.gap not in (0.0, "geometry"):
            raise ValueError(f"gap = {self.gap:g}: the distance from a plane is that of the mesh; leave it out")
        if self.against == "ground" and self.gap == "geometry":
            raise ValueError('gap = "geometry": ground has the shape of the surface; state a number, or against = "plane"')


class Force(Table):
    """[[statics.forces]]: a constant force, shared by its nodes, or a moment."""

    position: Vector | None = Field(None, description="three coordinates [x, y, z] in m; the nearest node is loaded")
    node: Number | None = Field(None, description="a node number of the mesh, a whole number of at least 0")
    group: str | None = Field(None, min_length=1, description="the name of a group in the mesh; its nodes share the force")
    point: str | None = Field(None, min_length=1, description="the name of one of the [[points]]")
    force: Direction | None = Field(None, description="the force [x, y, z] in N, three numbers, not all 0")
    moment: Direction | None = Field(None, description="the moment [x, y, z] in N m, three numbers, not all 0")

    @model_validator(mode="after")
    def _place(self):
        self.exactly_one("position", "node", "group", *["point"] * (self.point is not None))
        if self.moment is None and self.force is None:
            raise ValueError(f"force is missing: expected {Force.model_fields['force'].description}; or moment")
        self.exactly_one("force", *["moment"] * (self.moment is not None))
        if self.moment is not None and self.group is None and self.point is None:
            raise ValueError("moment acts on a group of nodes or on a point; a node alone bears none")
        return self


class Pressure(Table):
    """[[statics.pressures]]: a constant pressure on a surface."""

    group: str = Field(min_length=1, description="the name of a group of faces in the mesh")
    pressure: float = Field(description="the pressure in Pa, a number; above 0 it pushes into the body")


class Temperature(Table):
    """[[statics.temperatures]]: a body that is warmer than where it is free of stress."""

    group: str = Field(min_length=1, description="the name of a group of volume elements in the mesh, of one of the bodies")
    temperature: float | None = Field(None, description="the temperature in K above that without stress, a number")
    field: str | None = Field(None, min_length=1, description="the name of a field of the mesh that has it at the nodes")
    file: str | None = Field(None, min_length=1, description="the path of a CSV file with the columns node and temperature")

    @model_validator(mode="after")
    def _one(self):
        self.exactly_one("temperature", "field", "file")
        return self


class MovedSupport(Table):
    """[[statics.displacements]]: nodes of a support, moved before the vibration and held there."""

    group: str = Field(min_length=1, description="the name of a group in the mesh, of nodes that [[supports]] hold")
    displacement: Direction = Field(
        description="the displacement [x, y, z] in m, three numbers, not all 0; directions other than 0 are those of a support"
    )


class Bolt(Table):
    """[[statics.bolts]]: a shank that is cut and pulled together."""

    group: str = Field(min_length=1, description="the name of a group of faces that cross the shank inside the mesh")
    force: Positive | None = Field(None, description="the clamping force in N to which the bolt is tightened, a number above 0")
    shortening: Positive | None = Field(None, description="the length in m that is taken out of the shank, a number above 0")
    name: Name | None = Field(None, description="a name for tables and messages, without comma, quote or slash")

    @model_validator(mode="after")
    def _one(self):
        self.exactly_one("force", "shortening")
        return self


class Statics(Table):
    """[statics]: what the joint carries before it vibrates."""

    rotation_speed: NotNegative = Field(0.0, description="the speed of rotation in rad/s, a number of at least 0")
    stress_stiffening: bool = Field(
        True, description="true or false: the vibration feels the stress at rest and, where it rotates, spin softening"
    )
    deformed_shape: bool = Field(False, description="true or false: the vibration feels the change of shape at rest, too")
    large_displacements: bool = Field(
        False, description="true or false: equilibrium and vibration in the deformed shape, with strains of second order"
    )
    steps: int = Field(10, ge=1, le=100_000, description="the number of load steps, a whole number of at least 1")
    forces: tuple[Force, ...] = Field((), description="tables, each headed [[statics.forces]], with a place and force")
    pressures: tuple[Pressure, ...] = Field((), description="tables, each headed [[statics.pressures]], with group and pressure")
    temperatures: tuple[Temperature, ...] = Field(
        (), description="tables, each headed [[statics.temperatures]], with group and temperature"
    )
    bolts: tuple[Bolt, ...] = Field(
        (), description="tables, each headed [[statics.bolts]], with group and force, or with group and shortening"
    )
    displacements: tuple[MovedSupport, ...] = Field(
        (), description="tables, each headed [[statics.displacements]], with group and displacement"
    )

    @model_validator(mode="after")
    def _large(self):
        if self.large_displacements and not self.stress_stiffening:
            raise ValueError("large_displacements = true goes with stress_stiffening; the one without the other is no stiffness")
        if self.large_displacements and self.bolts:
            raise ValueError("large_displacements = true: bolts are tightened with small displacements; leave out one of them")
        return self

    @model_validator(mode="after")
    def _deformed(self):
        if self.deformed_shape and not self.stress_stiffening:
            raise ValueError("deformed_shape = true goes with stress_stiffening; the one without the other is no stiffness")
        return self


class Load(Table):
    """[[loads]]: level x direction, pressure or forces of a file, in one harmonic."""

    position: Vector | None = Field(None, description="three coordinates [x, y, z] in m; the nearest node is loaded")
    node: Number | None = Field(None, description="a node number of the mesh, a whole number of at least 0")
    group: str | None = Field(None, min_length=1, description="the name of a group in the mesh; its nodes share the load")
    point: str | None = Field(None, min_length=1, description="the name of one of the [[points]]")
    dof: Number | None = Field(None, description="a DOF number of the matrices, a whole number of at least 0")
    direction: Direction | None = Field(None, description="three numbers [x, y, z], not all 0; each level multiplies them")
    moment: Direction | None = Field(
        None, description="a moment [x, y, z] at a point in N m per N of the level, three numbers, not all 0"
    )
    scale: float = Field(1.0, description="a number that each level multiplies, for a load on a dof")
    pressure: NotZero | None = Field(
        None, description="the pressure in Pa on a group of faces, a number, not 0; above 0 it pushes into the body"
    )
    travelling: Direction | None = Field(
        None, description="how the phase of the pressure changes along x, y, z, three numbers in rad/m, not all 0"
    )
    engine_order: int | None = Field(
        None, ge=-10_000, le=10_000, description="how often the phase of the pressure turns about [model] axis, a whole number"
    )
    forces: str | None = Field(None, min_length=1, description="the path of a CSV file of forces, which each level multiplies")
    base_acceleration: Direction | None = Field(
        None,
        description="the acceleration of the supports, three numbers [x, y, z], not all 0; each level in m/s2 multiplies them",
    )
    harmonic: int = Field(1, ge=0, le=10_000, description="the harmonic of the load, a whole number of at least 0")
    phase: float = Field(0.0, description="the phase in rad, a number")

    @model_validator(mode="after")
    def _place(self):
        if self.base_acceleration is not None:
            others = (*_PLACES, "direction", "moment", "scale", "pressure", *_PHASES, "forces")
            _refuse_keys(self, "base_acceleration, which moves all supports", *others)
        elif self.forces is not None:
            _refuse_keys(
                self, "forces: the file holds places and values", *_PLACES, "direction", "moment", "scale", "pressure", *_PHASES
            )
        elif self.pressure is not None:
            _refuse_keys(
                self,
                "a pressure: it acts on a group of faces",
                "position",
                "node",
                "point",
                "dof",
                "direction",
                "moment",
                "scale",
            )
            self.exactly_one("group")
            if all(getattr(self, key) is not None for key in _PHASES):
                raise ValueError("exactly one of travelling, engine_order may vary the phase, found both")
        else:
            _refuse_keys(self, "a force: it belongs to a pressure", *_PHASES)
            _check_place(self, self.exactly_one("position", "node", "group", "dof", *["point"] * (self.point is not None)))
        return self


class Output(Table):
    """[[outputs]]: the displacement of one node along one direction, or what follows from displacements and contact forces."""

    name: Name = Field(description="a name for tables and pictures, without comma, quote or slash")
    position: Vector | None = Field(None, description="three coordinates [x, y, z] in m; the nearest node is meant")
    node: Number | None = Field(None, description="a node number of the mesh, a whole number of at least 0")
    point: str | None = Field(None, min_length=1, description="the name of one of the [[points]]")
    dof: Number | None = Field(None, description="a DOF number of the matrices, a whole number of at least 0")
    direction: Direction | None = Field(None, description="three numbers [x, y, z], not all 0")
    rotation: Direction | None = Field(None, description="the axis [x, y, z] of a point's rotation in rad, not all 0")
    quantity: Quantity = Field(
        "displacement", description='"displacement", "velocity", "acceleration", "stress", "strain" or "contact_force"'
    )
    component: Component | None = Field(
        None, description='"xx", "yy", "zz", "xy", "yz" or "zx" of stress and strain; "normal" of a contact force'
    )
    body: str | None = Field(None, min_length=1, description="the NAME of a table [bodies.NAME], whose stress or strain is meant")
    joint: str | None = Field(None, min_length=1, description="the name of one of [[joints]], whose contact force is meant")
    absolute: bool = Field(False, description="true or false: with the motion of the base, under base_acceleration")

    @model_validator(mode="after")
    def _place(self):
        if self.quantity == "contact_force":
            _refuse_keys(
                self, 'quantity = "contact_force": it belongs to a joint', *_PLACES_OF_OUTPUTS, "rotation", "body", "absolute"
            )
            if self.joint is None:
                raise ValueError(f"joint is missing: expected {Output.model_fields['joint'].description}")
            self.exactly_one("direction", "component")
            if self.component not in (None, "normal"):
                raise ValueError(
                    f'component = "{self.component}" belongs to stress and strain; of a contact force expected "normal"'
                )
        elif self.quantity in ("stress", "strain"):
            _refuse_keys(self, f'quantity = "{self.quantity}"', "dof", "point", "direction", "rotation", "joint", "absolute")
            self.exactly_one("position", "node")
            if self.component in (None, "normal"):
                raise ValueError(f'component is missing: expected "xx", "yy", "zz", "xy", "yz" or "zx" of {self.quantity}')
        else:
            _refuse_keys(self, f'quantity = "{self.quantity}"', "component", "body", "joint")
            _check_place(self, self.exactly_one("position", "node", "dof", *["point"] * (self.point is not None)))
        return self


_PLACES = ("position", "node", "group", "point", "dof")
_PLACES_OF_OUTPUTS = ("position", "node", "point", "dof")
_PHASES = ("travelling", "engine_order")


def _refuse_keys(entry: Load | Output, why: str, *keys: str) -> None:
    """Raise ValueError if one of the keys is given."""
    for key in keys:
        if key in entry.model_fields_set:
            raise ValueError(f"{key} does not go with {why}")


def _check_place(entry: Load | Output, key: str) -> None:
    """Raise ValueError unless a node comes with a direction, a dof without one, and a point with that or its rotation."""
    turn = "moment" if isinstance(entry, Load) else "rotation"
    if getattr(entry, turn) is not None:
        if key != "point":
            raise ValueError(f"{turn} belongs to a point; nodes do not turn")
        entry.exactly_one("direction", turn)
        if "scale" in entry.model_fields_set:
            raise ValueError("scale belongs to a load on a dof; with a moment, state it there")
        return
    if key == "dof":
        if entry.direction is not None:
            raise ValueError("direction belongs to a node; a dof has its own")
    elif entry.direction is None:
        raise ValueError(f"direction is missing: expected {type(entry).model_fields['direction'].description}")
    elif "scale" in entry.model_fields_set:
        raise ValueError("scale belongs to a load on a dof; with a direction, state it there")


def _each_mode_once(pairs: tuple[tuple[int, float], ...]) -> tuple[tuple[int, float], ...]:
    _no_duplicates(tuple(mode for mode, _ in pairs))
    return pairs


class Damping(Table):
    """[damping]: of every mode, of some by number, or Rayleigh's; structural damping beside it."""

    ratio: float | None = Field(None, ge=0, lt=1, description="the ratio to critical damping, a number of at least 0 and below 1")
    rayleigh: tuple[NotNegative, NotNegative] | None = Field(
        None, description="[alpha, beta] of C = alpha M + beta K in 1/s and s, two numbers of at least 0"
    )
    ratios: Annotated[tuple[Ratio, ...], Field(min_length=1)] | None = Field(
        None, description="the ratios of modes 1, 2, ..., a list of numbers of at least 0 and below 1"
    )
    modes: Annotated[tuple[tuple[ModeNumber, Ratio], ...], AfterValidator(_each_mode_once), Field(min_length=1)] | None = Field(
        None, description="a list of [number of a mode, its ratio], each mode once, ratios of at least 0 and below 1"
    )
    structural: float | None = Field(
        None, ge=0, le=1, description="the loss factor of the bodies, a number of at least 0 and at most 1"
    )

    @model_validator(mode="after")
    def _one(self):
        if self.rayleigh is not None:
            for key in ("ratios", "modes"):
                if getattr(self, key) is not None:
                    raise ValueError(f"{key} goes with ratio, which all other modes have; rayleigh damps every mode already")
        if self.ratios is not None and self.modes is not None:
            raise ValueError("exactly one of ratios, modes is needed, found both")
        if self.modes is not None and self.ratio is None:
            raise ValueError(
                f"ratio is missing, which the modes that are not named have: expected {Damping.model_fields['ratio'].description}"
            )
        if self.rayleigh is not None or (self.ratios is None and self.structural is None):
            self.exactly_one("ratio", "rayleigh")
        return self


class Response(Table):
    """[response]: levels and frequencies of the curves."""

    levels: Annotated[tuple[Positive, ...], AfterValidator(_no_duplicates)] = Field(
        min_length=1, description="a list of load levels in N, numbers above 0, each once"
    )
    frequencies: Annotated[tuple[Frequency, Frequency], AfterValidator(_rising)] | None = Field(
        None, description="two frequencies in Hz, above 0 and at most 1e9, the lower one first"
    )
    mode: int | None = Field(None, ge=1, description="the number of a mode, a whole number of at least 1")
    span: Annotated[tuple[Positive, Positive], AfterValidator(_rising)] | None = Field(
        None, description="two factors of the mode's frequency, above 0, the lower one first"
    )
    points: int = Field(100, ge=2, le=10_000_000, description="the number of points a level, a whole number of at least 2")
    at: Annotated[tuple[Frequency, ...], AfterValidator(_no_duplicates)] = Field(
        (), description="a list of frequencies in Hz, above 0, each once"
    )
    direction: Literal["up", "down"] = Field("up", description='the direction of the sweep, "up" or "down"')
    fields: bool = Field(True, description="true or false: write modes and the motion at the peaks on the mesh")

    @model_validator(mode="after")
    def _range(self):
        if self.exactly_one("frequencies", "mode") == "mode" and self.span is None:
            raise ValueError("span is missing: with mode, expected " + str(Response.model_fields["span"].description))
        if self.frequencies is None:
            return self
        if self.span is not None:
            raise ValueError("span belongs to mode; with frequencies it means nothing")
        low, high = self.frequencies
        for frequency in self.at:
            if not low <= frequency <= high:
                raise ValueError(f"at holds {frequency:g} Hz, outside frequencies = [{low:g}, {high:g}]")
        return self


class Solver(Table):
    """[solver]: the method and its accuracy."""

    method: Method = Field("receptance", description="a method's name")
    accuracy: float | None = Field(
        None, gt=0, lt=1, description="the error of the response that is accepted, over its peak, a number above 0 and below 1"
    )
    modes: int | None = Field(None, ge=1, le=LARGEST_NUMBER, description="the number of modes, a whole number of at least 1")
    harmonics: int = Field(3, ge=0, le=10_000, description="the highest harmonic, a whole number of at least 0")
    samples: int = Field(128, ge=1, le=10_000_000, description="the time samples per period, a whole number above 2 x harmonics")
    between_samples: Literal["path", "return-map"] = Field(
        "path", description='"path": the contact law follows the motion between samples; "return-map": it knows samples alone'
    )
    energy_tolerance: NotNegative = Field(1e-10, description="the energy in J per cycle and pair, a number of at least 0")
    tolerance: float = Field(1e-8, gt=0, lt=1, description="the relative tolerance of a point, a number above 0 and below 1")
    condensed: bool = Field(False, description="true or false: rubin with relative interface DOFs only")
    interface_modes: int = Field(
        DEFAULT_INTERFACE_MODES, ge=1, le=LARGEST_NUMBER, description="the shapes of the joint, a whole number of at least 1"
    )
    in_point_check: bool = Field(False, description="true or false: check all pairs inside the point")
    error_bars: bool = Field(True, description="true or false: estimate the error of every point")
    verify_modes: bool = Field(True, description="true or false: prove by a count that no mode is missed")

    @model_validator(mode="after")
    def _sampled(self):
        if self.samples <= 2 * self.harmonics:
            raise ValueError(
                f"samples = {self.samples} do not resolve harmonics = {self.harmonics}; "
                f"at least {2 * self.harmonics + 1} are needed, {max(128, 16 * self.harmonics)} are advised"
            )
        return self


class Continuation(Table):
    """[continuation]: lengths of the steps along the curve; each that is left out follows from [response] points."""

    ds: Positive | None = Field(None, le=1, description="the first step as a fraction of the curve, above 0 and at most 1")
    ds_min: Positive | None = Field(None, le=1, description="the shortest step as a fraction of the curve, above 0 and at most 1")
    ds_max: Positive | None = Field(None, le=1, description="the longest step as a fraction of the curve, above 0 and at most 1")

    @model_validator(mode="after")
    def _ordered(self):
        given = [(key, getattr(self, key)) for key in ("ds_min", "ds", "ds_max") if getattr(self, key) is not None]
        for (lower, small), (upper, large) in pairwise(given):
            if small > large:
                raise ValueError(f"{lower} = {small:g} is above {upper} = {large:g}; ds_min <= ds <= ds_max is needed")
        return self


class Scene(Table):
    """A scene file, checked; attributes are its keys."""

    title: str = Field("", description="a text in quotes")
    model: Model = Field(description="a table [model] with mesh, or with stiffness and mass")
    materials: dict[str, Material] = Field({}, description="tables [materials.NAME] with young, poisson and density")
    bodies: dict[str, Body] = Field({}, description="tables [bodies.NAME] with group and material")
    supports: tuple[Support, ...] = Field((), description="tables, each headed [[supports]], with group and fix")
    joints: tuple[Joint, ...] = Field((), description="tables, each headed [[joints]], with name, surfaces, friction, ...")
    ties: tuple[Tie, ...] = Field((), description="tables, each headed [[ties]], with surfaces")
    surfaces: tuple[Surface, ...] = Field((), description="tables, each headed [[surfaces]], with name and bodies")
    points: tuple[Point, ...] = Field((), description="tables, each headed [[points]], with name, position and group")
    masses: tuple[Mass, ...] = Field((), description="tables, each headed [[masses]], with group and mass")
    springs: tuple[Spring, ...] = Field(
        (), description="tables, each headed [[springs]], with groups, direction, and stiffness or damping"
    )
    orientations: dict[str, Orientation] = Field({}, description="tables [orientations.NAME] with directions, or axis")
    statics: Statics | None = Field(None, description="a table [statics]")
    loads: tuple[Load, ...] = Field(min_length=1, description="at least one table headed [[loads]], with position and direction")
    outputs: tuple[Output, ...] = Field(
        min_length=1, description="at least one table headed [[outputs]], with name, position and direction"
    )
    damping: Damping | None = Field(None, description="a table [damping] with ratio, or with rayleigh = [alpha, beta]")
    response: Response = Field(description="a table [response] with levels and frequencies")
    solver: Solver = Field(Solver(), description="a table [solver]")
    continuation: Continuation | None = Field(None, description="a table [continuation]")

    _path: Path = PrivateAttr(default=Path("scene.toml"))
    _text: str = PrivateAttr(default="")
    _is_complete: bool = PrivateAttr(default=False)
    _settings: tuple[str, ...] = PrivateAttr(default=())

    def model_post_init(self, context: Any, /) -> None:
        """Take path and text, whether the model file has been read, and what was set, from the validation's context."""
        if context:
            self._path, self._text, self._is_complete = context["path"], context["text"], context["is_complete"]
            self._settings = context["settings"]

    def chooses(self, key: str) -> bool:
        """Tell whether the program chooses harmonics, samples or tolerance at each point, by the accuracy asked for."""
        return self.solver.accuracy is not None and key not in self.solver.model_fields_set

    @property
    def is_complete(self) -> bool:
        """Whether all that its model file states has been taken over."""
        return self._is_complete

    @property
    def awaits_file(self) -> bool:
        """Whether the model file may still add materials, bodies, supports and points to the scene."""
        file = self.model.mesh
        return not self.is_complete and file is not None and Path(file).suffix.lower() in WHOLE_MODELS

    @property
    def harmonics(self) -> int:
        """The highest harmonic: as stated, or where the program chooses, enough for the loads."""
        loaded = max((load.harmonic for load in self.loads), default=0) if self.chooses("harmonics") else 0
        return max(self.solver.harmonics, loaded)

    @property
    def is_static(self) -> bool:
        """Whether harmonic 0 alone is solved for: nothing vibrates."""
        return self.harmonics == 0

    @property
    def path(self) -> Path:
        """The scene file, absolute."""
        return self._path

    @property
    def folder(self) -> Path:
        """The folder that the scene's paths are relative to."""
        return self._path.parent

    @property
    def name(self) -> str:
        """The file's name without its ending."""
        return self._path.stem

    @property
    def text(self) -> str:
        """The file's text, or where the command line set keys, that of a file with them."""
        return self._text

    @property
    def settings(self) -> tuple[str, ...]:
        """What the command line set, as KEY=VALUE."""
        return self._settings

    @property
    def source(self) -> str:
        """The scene file and what the command line set in it, for logs."""
        return " ".join([str(self._path), *(f"--set {setting}" for setting in self.settings)])
