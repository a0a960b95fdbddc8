"""All tables of a structure together, the input of mesh and assembly.  A scene adds the tables of the solution."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field, PrivateAttr

from .constant_loads import Statics
from .cyclic import Cyclic
from .joint import Joint
from .structure import Body, Mass, Material, Model, Orientation, Point, Spring, Support, Surface, Tie
from .table import Table
from .vibration import Load, Output

if TYPE_CHECKING:
    from ..elements import SolidSection


class StructureTables(Table):
    """The tables of a structure and of the loads on it."""

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
    cyclic: Cyclic | None = Field(None, description="a table [cyclic] with sectors, axis, faces and engine_order")
    statics: Statics | None = Field(None, description="a table [statics]")
    loads: tuple[Load, ...] = Field((), description="tables, each headed [[loads]], with position and direction")
    outputs: tuple[Output, ...] = Field((), description="tables, each headed [[outputs]], with name, position and direction")

    _path: Path = PrivateAttr(default=Path("scene.toml"))

    @property
    def path(self) -> Path:
        """The scene file, absolute."""
        return self._path

    @property
    def has_equations(self) -> bool:
        """Whether the equations of the model file hold."""
        return "equations" in self.model.take

    @property
    def body_of(self) -> dict[str, str]:
        """The body of each group of volume elements."""
        return {body.group: name for name, body in self.bodies.items()}

    @cached_property
    def sections(self) -> Mapping[str, SolidSection]:
        """What the elements of each body are made of, by its name."""
        from .sections import section_of  # NumPy, which a scene is read without

        return {
            name: section_of(body, self.materials[body.material], self.orientations.get(body.orientation or ""))
            for name, body in self.bodies.items()
        }

    @property
    def axis_of_rotation(self) -> tuple[tuple[float, float, float], tuple[float, float, float]] | None:
        """Direction and a point [m] of the axis of rotation; a disc turns about its own.  None where none is stated."""
        if self.cyclic is not None:
            return self.cyclic.axis, self.cyclic.axis_point
        return None if self.model.axis is None else (self.model.axis, self.model.axis_point)

    @property
    def attached(self) -> list[tuple[str, str]]:
        """The groups of masses and springs, each after the key that names it; their nodes may belong to no element."""
        named = [(f"[[masses]] {i} group", mass.group) for i, mass in enumerate(self.masses, 1) if mass.group is not None]
        return named + [(f"[[springs]] {i} groups", group) for i, spring in enumerate(self.springs, 1) for group in spring.groups]

    @property
    def groups_on_bodies(self) -> list[tuple[str, str]]:
        """The groups of supports, joints, ties, points, loads and cyclic faces, each after the key that names it."""
        named = _groups("supports", self.supports)
        named += [(f"[[joints]] {joint.name!r} surfaces", group) for joint in self.joints for group in joint.groups]
        named += [(f"[[ties]] {tie.label!r} surfaces", group) for tie in self.ties for group in tie.surfaces]
        named += [(f"[[points]] {point.name!r} group", point.group) for point in self.points]
        named += _groups("loads", self.loads)
        if self.cyclic is not None and self.cyclic.faces is not None:
            named += [("[cyclic] faces", group) for group in self.cyclic.faces]
        if self.statics is not None:
            for table in ("forces", "pressures", "bolts", "displacements"):
                named += _groups(f"statics.{table}", getattr(self.statics, table))
        return named


def _groups(table: str, entries: tuple[Any, ...]) -> list[tuple[str, str]]:
    """Return the groups of a list of tables, each after the key that names it."""
    return [(f"[[{table}]] {i} group", entry.group) for i, entry in enumerate(entries, 1) if entry.group is not None]
