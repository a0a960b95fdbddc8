"""The content of a model file as lines: elements, bodies with volume and mass, materials, groups, findings."""

from collections import Counter
from collections.abc import Collection, Mapping

import numpy as np

from ... import elements
from ...formats.model import FileModel
from ...mesh.data import Mesh
from ...mesh.skin import faces_of_group, skin_of_mesh
from ...messages.words import counted, listed, place
from ...tables.joint import Joint
from ...tables.structure import TAKEN, Body, Material, Orientation
from ...tables.units import Units

MOST = 40  # groups, findings or bodies listed individually


def table(heading: str, lines: list[str], most: int = MOST) -> list[str]:
    """Return lines after a heading, at most ``most`` of them and the number of the others.  Local."""
    shown = lines[:most] + ([f"... and {len(lines) - most} more ({len(lines)} in all)"] if len(lines) > most else [])
    return [f"{heading if i == 0 else '':10} {line}" for i, line in enumerate(shown)]


def elements_of(mesh: Mesh) -> str:
    """Return the number of elements of each kind as text.  Local."""
    counts: Counter[str] = Counter()
    for block in mesh.elements:
        counts[block.kind] += len(block.nodes)
    return ", ".join(f"{n} {kind}" for kind, n in counts.items())


def volumes(mesh: Mesh, of_scene: Mapping[str, Body]) -> dict[str, float]:
    """Return the volume of each body [m3].  Local, rank 0."""
    of_group = dict.fromkeys((body.group for body in of_scene.values()), 0.0)
    for block in mesh.elements:
        of_group[block.group] += float(elements.volumes(block.kind, mesh.points[block.nodes]).sum())
    return {name: of_group[body.group] for name, body in of_scene.items()}


def mass(volume: Mapping[str, float], density: Mapping[str, float]) -> float:
    """Return the mass of all bodies [kg].  Local."""
    return sum(volume[name] * density[name] for name in volume)


def bodies(mesh: Mesh, of_scene: Mapping[str, Body], volume: Mapping[str, float], density: Mapping[str, float]) -> list[str]:
    """Return a line for each body with its volume and mass, and one for their sum; NaN is an unknown density.

    Local, rank 0.
    """
    lines = []
    for name, body in of_scene.items():
        kinds = ", ".join(f"{len(block.nodes)} {block.kind}" for block in mesh.elements if block.group == body.group)
        group = "" if name == body.group else f" (group {body.group})"
        lines.append(f"{name}{group}: {kinds}, {volume[name]:.6g} m3{_kilograms(volume[name] * density[name])}")
    in_all = f"{sum(volume.values()):.6g} m3{_kilograms(mass(volume, density))} in all"
    return table("bodies", lines) + (table("", [in_all]) if len(lines) > 1 else [])


def _kilograms(mass: float) -> str:
    return "" if np.isnan(mass) else f", {mass:.6g} kg"


def groups(mesh: Mesh, of_scene: Mapping[str, Body]) -> list[str]:
    """Return a line for each named group that is not a body: its nodes and outer faces.  Local."""
    skin, of_bodies = skin_of_mesh(mesh), {body.group for body in of_scene.values()}
    lines = []
    for name, nodes in mesh.node_groups.items():
        if name in of_bodies or len(nodes) == 0:
            continue
        outer = faces_of_group(mesh, skin, name)
        text = f"{name}: {counted(len(nodes), 'node')}"
        n_named = sum(len(block.nodes) for block in mesh.faces if block.group == name)
        if len(outer):
            text += f", {counted(len(outer), 'outer face')} of {skin.area[outer].sum():.6g} m2"
        elif n_named:
            text += f", {counted(n_named, 'face')}, none of them outside"
        lines.append(text)
    return table("groups", lines)


def materials(of: Mapping[str, Material]) -> list[str]:
    """Return a line for each material, in SI units.  Local."""
    lines = []
    for name, material in of.items():
        density = f"density {material.density:.6g} kg/m3" if material.density is not None else "no density"
        lines.append(f"{name}: {', '.join([*elastic(material), density, *expansion(material)])}")
    return table("materials", lines)


def elastic(material: Material) -> list[str]:
    """Return the elastic constants of a material in SI units as text.  Local."""
    if material.elasticity is not None:
        along_axes = _numbers(tuple(material.elasticity[i][i] for i in range(6)))
        return [f"elasticity along its axes {along_axes} Pa and between them"]
    parts = [f"young {_numbers(material.young)} Pa"] if material.young is not None else ["no young"]
    parts += [f"poisson {_numbers(material.poisson)}" if material.poisson is not None else "no poisson"]
    return parts + ([f"shear {_numbers(material.shear)} Pa"] if material.shear is not None else [])


def expansion(material: Material) -> list[str]:
    """Return the thermal expansion of a material as text; empty if not stated.  Local."""
    return [f"expansion {_numbers(material.expansion)} 1/K"] if material.expansion is not None else []


def axes(orientations: Mapping[str, Orientation], bodies: Mapping[str, Body], length: float = 1.0) -> list[str]:
    """Return a line for the axes of materials and their bodies; ``length``: unit of length [m].  Local."""
    lines = []
    for name, orientation in orientations.items():
        of = ", ".join(body for body, properties in bodies.items() if properties.orientation == name)
        if orientation.directions is not None:
            text = f"1 along {place(orientation.directions[0])}, 2 towards {place(orientation.directions[1])}"
        else:
            point = np.multiply(orientation.axis_point or (0.0, 0.0, 0.0), length)
            text = f"around {place(orientation.axis or ())} through {place(point)} m"
        lines.append(f"{name}: {text}" + (f", of {of}" if of else ""))
    return table("axes", lines)


def _numbers(value: float | tuple[float, ...]) -> str:
    """Return one or several numbers as text."""
    return " ".join(f"{number:.6g}" for number in (value if isinstance(value, tuple) else (value,)))


def attached(file: FileModel, units: Units) -> list[str]:
    """Return lines for supports, ties, joints, points, masses, springs, equations and bolts of the file, in SI units.  Local."""
    lines = table("supports", [f"{support.group or support.point}: {', '.join(support.fix)}" for support in file.supports])
    lines += table("ties", [f"{ty.name + ': ' if ty.name else ''}{' on '.join(ty.surfaces)}" for ty in file.ties])
    lines += table("joints", [_joint(joint, units) for joint in file.joints])
    points = [
        f"{point.name}: {point.connection}, {point.group}, at {place(np.multiply(point.position, units.length))} m"
        + (f", {point.mass * units.mass:.6g} kg" if point.mass else "")
        for point in file.connected
    ]
    lines += table("points", points)
    lines += table("masses", [f"{mass.group}: {mass.mass * units.mass:.6g} kg a node" for mass in file.masses])
    springs = [(spring.groups, spring.stiffness * units.stiffness, spring.damping * units.damping) for spring in file.springs]
    lines += table("springs", [spring(*point) for point in springs])
    if file.equations is not None:
        where = file.equations.where
        lines += table("equations", [f"{len(where)}, the first of them {where[0]}" if where else "none"])
    return lines + table("bolts", [f"{bolt.name}: a cut, {bolt.group}" for bolt in file.bolts])


def spring(groups: tuple[str, ...], stiffness: float, damping: float) -> str:
    """Return a spring as text [N/m, N s/m]; a damper has no stiffness."""
    parts = [f"{stiffness:.6g} N/m"] if stiffness or not damping else []
    parts += [f"{damping:.6g} N s/m"] if damping else []
    return f"{' to '.join(groups)}: {', '.join(parts)}"


def _joint(joint: Joint, units: Units) -> str:
    """Return a joint of the file as text, in SI units."""
    known = joint.in_si(units)
    parts = [f"friction {joint.friction:g}"] if joint.friction is not None else ["no friction coefficient"]
    for which in ("tangential", "normal"):
        value = known.get(f"{which}_stiffness")
        parts.append(f"no {which} stiffness" if value is None else f"{which} stiffness {value:.6g} N/m3")
    return f"{joint.name}: {' on '.join(joint.surfaces or ())}, {', '.join(parts)}"


def loads_at_rest(file: FileModel) -> list[str]:
    """Return a line on the loads at rest that a scene takes over.  Local."""
    statics = file.statics
    if statics is None or not statics.acts:
        return []
    return table("at rest", [f"{listed(statics.kinds, 'and')} of step {statics.step}, in a scene [statics]"])


def passed_over(file: FileModel) -> list[str]:
    """Return a line for each finding that no scene answers by taking loads over; those that change the answer first.  Local."""
    answered = set() if file.statics is None else {file.statics.word, file.statics.large}
    findings = [finding for finding in file.findings if finding.word not in answered]
    headed = [("to answer" if each.changes else "taken over" if each.is_taken else "left out", each) for each in findings]
    counts = Counter((each.word, each.effect, heading) for heading, each in headed)
    first: dict[tuple[str, str, str], str] = {}
    lines = []
    for heading, each in headed:
        first.setdefault((each.word, each.effect, heading), each.where)
    for heading in ("to answer", "taken over", "left out"):
        keys = [key for key in counts if key[2] == heading]
        rows = [f"{first[key]}: {key[0]}: {key[1]}{f' ({counts[key]} times)' if counts[key] > 1 else ''}" for key in keys]
        lines += table(heading, rows)
    return lines


def steps(file: FileModel, parts: Collection[str] = TAKEN) -> list[str]:
    """Return a table of the file's steps: the conditions of each, marked if taken over with ``parts``.  Local."""
    if not file.steps:
        return []
    part_of = {"supports": "supports", "loads": "statics", "temperatures": "statics"}
    rows = [("step", "procedure", *part_of, "taken over")]
    for step in file.steps:
        taken = [kind for kind in step.states if kind in step.taken and part_of[kind] in parts]
        states = [step.states.get(kind, "-") for kind in part_of]
        rows.append((str(step.number or "-"), step.procedure, *states, ", ".join(taken) or "nothing"))
    widths = [max(map(len, column)) for column in zip(*rows)]
    lines = ["  ".join(f"{text:{width}}" for text, width in zip(row, widths)).rstrip() for row in rows]
    chosen = f"conditions of step {file.step}" + ("; [model] step = ... takes another" if len(file.steps) > 2 else "")
    return table("steps", [*lines, chosen])


def facts(file: FileModel) -> list[str]:
    """Return the facts of the file, one per line.  Local."""
    return table("file", list(file.facts))
