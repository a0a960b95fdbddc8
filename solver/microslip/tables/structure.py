"""The tables of a structure: model file, materials, bodies, supports and connections."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self, get_args

from pydantic import AfterValidator, Field, field_validator, model_validator

from .matrix_names import KEYS as MATRICES
from .matrix_names import split_name
from .table import Direction, Name, NotNegative, Positive, Six, Table, ThreePositive, Vector, any_of, no_duplicates
from .units import UNITS as UNIT_SETS

_PARALLEL = 1e-6  # sine of the angle between directions that span no plane
Axis = Literal["x", "y", "z", "rx", "ry", "rz"]
Units = Literal["m-kg-s", "mm-t-s", "mm-kg-s", "mm-kg-ms", "in-lbf-s"]
UNITS: tuple[str, ...] = get_args(Units)
Taken = Literal["materials", "bodies", "supports", "ties", "joints", "points", "masses", "springs", "equations", "statics"]
TAKEN: tuple[Taken, ...] = get_args(Taken)


class Model(Table):
    """[model]: a mesh, or matrices of another program."""

    mesh: str | None = Field(None, min_length=1, description="the path of the mesh file, relative to the scene's folder")
    scale: Positive = Field(1.0, description="metres per unit of the mesh, a number above 0")
    units: Units | None = Field(None, description=f"the units of the model file, {any_of(UNITS)}")
    take: Annotated[tuple[Taken, ...], AfterValidator(no_duplicates)] = Field(
        TAKEN, description=f"what is taken over from the model file, a list of {any_of(TAKEN, 'and')}, each once"
    )
    ignore: Annotated[tuple[str, ...], AfterValidator(no_duplicates)] = Field(
        (), description='keywords of the model file to leave out, a list as "*CONTACT PAIR", each once'
    )
    step: int | None = Field(
        None, ge=1, description="the step of the model file whose conditions are taken over, a number from 1"
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

    @property
    def metres(self) -> float:
        """How long a unit of the mesh is [m]."""
        return self.scale if self.units is None else UNIT_SETS[self.units].length

    @property
    def matrices(self) -> dict[str, tuple[Path, str | None]]:
        """The file of each matrix that is stated, and its name there where it has one."""
        stated = {key: file for key in MATRICES if (file := getattr(self, key)) is not None}
        split = {key: split_name(file, self._folder) for key, file in stated.items()}
        return {key: (self._folder / file, name) for key, (file, name) in split.items()}

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
        for key in ("scale", "units", "take", "ignore", "step"):
            if self.mesh is None and key in self.model_fields_set:
                raise ValueError(f"{key} belongs to a mesh; matrices are taken in SI units, as they are")
        return self


class Material(Table):
    """[materials.NAME]: linear elastic, isotropic or with values along axes of its own."""

    QUANTITIES: ClassVar[Mapping[str, str]] = {"young": "stress", "shear": "stress", "elasticity": "stress", "density": "density"}

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
                    raise ValueError(f"{key} in addition to elasticity, which states everything; keep one of them")
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
        if self.has_axes:
            from .elasticity import elasticity_of  # NumPy, which other scenes are read without

            try:
                elasticity_of(self.elasticity, self.young, self.poisson, self.shear)
            except ValueError as problem:
                raise ValueError(f"there is no such material; {problem}") from None
        return self

    @property
    def has_axes(self) -> bool:
        """Whether it differs by direction."""
        return self.elasticity is not None or isinstance(self.young, tuple)

    @property
    def lacking(self) -> list[str]:
        """The keys that a model file does not state and a scene needs."""
        needed = ("density",) if self.elasticity is not None else ("young", "poisson", "density")
        return [key for key in needed if getattr(self, key) is None]

    @property
    def modulus(self) -> float | None:
        """The largest Young's modulus, or stress of a unit strain."""
        if self.elasticity is not None:
            return max(map(max, self.elasticity))
        return max(self.young) if isinstance(self.young, tuple) else self.young

    def with_axes(self) -> Self:
        """Return a material whose expansion alone differs by direction as one that has axes; any other as it is."""
        E, nu = self.young, self.poisson
        if not isinstance(self.expansion, tuple) or not isinstance(E, float) or not isinstance(nu, float):
            return self
        return self.with_keys(young=(E, E, E), poisson=(nu, nu, nu), shear=(0.5 * E / (1.0 + nu),) * 3)


class Orientation(Table):
    """[orientations.NAME]: the axes of a material."""

    QUANTITIES: ClassVar[Mapping[str, str]] = {"axis_point": "length"}

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
    fix: Annotated[tuple[Axis, ...], AfterValidator(no_duplicates)] = Field(
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
    """[[surfaces]]: a group of faces defined by the bodies that touch, or by a plane through one."""

    name: Name = Field(description="a name that joints, ties and others use as that of a group, without comma, quote or slash")
    bodies: tuple[str, str] = Field(
        description="the NAMEs of two tables [bodies.NAME]: faces of the first that lie on the second; or one twice"
    )
    normal: Direction | None = Field(
        None, description="the direction [x, y, z], out of the first body, in which the faces look, three numbers, not all 0"
    )
    tolerance: Positive | None = Field(None, description="how far apart in m the faces of the two may lie, a number above 0")
    through: Vector | None = Field(
        None, description="a point [x, y, z] in m of a plane across normal; the faces inside the body that follow it, as a cut"
    )

    @model_validator(mode="after")
    def _one_side(self):
        if self.through is not None and (self.bodies[0] != self.bodies[1] or self.tolerance is not None):
            raise ValueError("through belongs to one body, named twice, and a plane has no tolerance")
        if self.bodies[0] == self.bodies[1] and self.normal is None:
            raise ValueError(
                f'normal is missing, which distinguishes the two sides of "{self.bodies[0]}": expected '
                f"{Surface.model_fields['normal'].description}"
            )
        return self


class Tie(Table):
    """[[ties]]: two surfaces glued."""

    QUANTITIES: ClassVar[Mapping[str, str]] = {"tolerance": "length"}

    name: Name | None = Field(None, description="a name for messages, without comma, quote or slash")
    surfaces: tuple[str, str] = Field(
        description="the names of two different groups of faces; the nodes of the first follow the facets of the second"
    )
    tolerance: Positive | None = Field(
        None, description="the farthest distance in m of a node of the first surface from the second, a number above 0"
    )

    @property
    def label(self) -> str:
        """Its name, or what it ties."""
        return self.name or " to ".join(self.surfaces)

    @field_validator("surfaces")
    @classmethod
    def _two_surfaces(cls, surfaces):
        if surfaces[0] == surfaces[1] or not all(surfaces):
            raise ValueError("one surface twice")
        return surfaces


class Point(Table):
    """[[points]]: a point connected to a group of nodes, with three displacements and three small rotations."""

    QUANTITIES: ClassVar[Mapping[str, str]] = {
        "position": "length",
        "mass": "mass",
        "inertia": "inertia",
        "stiffness": "stiffness",
        "rotational_stiffness": "rotational_stiffness",
    }

    name: Name = Field(description="a name that loads, supports and outputs use, without comma, quote or slash")
    position: Vector = Field(description="three coordinates [x, y, z] in m")
    group: str = Field(min_length=1, description="the name of a group in the mesh")
    connection: Literal["rigid", "distributing", "equations"] = Field(
        "rigid",
        description='"rigid": the nodes follow the point; "distributing": it follows their mean; or "equations": equations '
        "of the model file alone connect it",
    )
    weights: Literal["area", "equal"] | tuple[Positive, ...] = Field(
        "area",
        description='the weights of that mean, "area" of each node, "equal" for all of them, or a number above 0 for each node '
        "of the group in the order of node numbers",
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

    @property
    def springs(self) -> tuple[float, ...]:
        """Stiffnesses to ground along x, y, z [N/m] and about them [N m/rad]."""
        return (*(self.stiffness or (0.0,) * 3), *(self.rotational_stiffness or (0.0,) * 3))

    @property
    def whole_inertia(self) -> tuple[float, ...]:
        """Moments of inertia xx, yy, zz, xy, yz, zx [kg m2]."""
        return (*(self.inertia or ()), *(0.0,) * 6)[:6]

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

    QUANTITIES: ClassVar[Mapping[str, str]] = {"mass": "mass"}

    group: str | None = Field(None, min_length=1, description="the name of a group in the mesh")
    point: str | None = Field(None, min_length=1, description="the name of one of the [[points]]")
    mass: NotNegative = Field(description="the mass in kg of each of its nodes, or of the point, a number of at least 0")

    @model_validator(mode="after")
    def _place(self):
        self.exactly_one("group", *["point"] * (self.point is not None))
        return self


class Spring(Table):
    """[[springs]]: nodes on springs and dampers to ground, or two nodes joined by one."""

    QUANTITIES: ClassVar[Mapping[str, str]] = {"stiffness": "stiffness", "damping": "damping"}

    groups: Annotated[tuple[str, ...], AfterValidator(no_duplicates), Field(max_length=2)] = Field(
        (), description="the name of a group whose nodes have springs to ground, or of two groups of one node each, in a list"
    )
    points: Annotated[tuple[str, ...], AfterValidator(no_duplicates), Field(max_length=2)] = Field(
        (), description="the names of one or two of the [[points]] that it holds, in a list, in place of groups or with one"
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
