"""Generate a beam of two halves, bolted as the Brake-Reuss beam, as an Abaqus input file in the style of Abaqus/CAE.

    python meshes/brake_reuss.py --out meshes/brake_reuss.inp

In mm, t and s.  Parts HALF_BEAM, BOLT, NUT and WASHER; two halves, the second turned by half a revolution, and three bolts with a
nut and two washers each.  Axes: x along the beam from the clamped end, z upwards; the halves touch at z = 0.  Ties connect
washers to beams, heads and nuts to washers, and nuts to threads; the halves are in contact; a sensor at the free end is a mass on
a reference point, coupled to the end face; the first step tightens the bolts, by pre-tension sections at z = 0.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from blocks import Body, box, jacobian_minimum, join
from bolted_lap import _Cells, _circle, _rectangle, _ring
from generator import add_options, named, option, parser_of

TYPES = {"hex8": "C3D8I", "hex20": "C3D20"}
# Faces S1, S2, ... of a hexahedron by its corners.
FACES = ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))
AFTER_THE_ASSEMBLY = """*Material, name=STEEL
*Density
 7.85e-09,
*Elastic
210000., 0.3
**
** INTERACTION PROPERTIES
**
*Surface Interaction, name=STEEL_ON_STEEL
1.,
*Friction, slip tolerance=0.005
 0.2,
*Surface Behavior, pressure-overclosure=HARD
**
** BOUNDARY CONDITIONS
**
*Boundary
CLAMPED, ENCASTRE
**
** INTERACTIONS
**
*Contact Pair, interaction=STEEL_ON_STEEL, type=SURFACE TO SURFACE
LAP_LOWER, LAP_UPPER
** ----------------------------------------------------------------
**
** STEP: Tighten
**
*Step, name=Tighten, nlgeom=NO
*Static
1., 1., 1e-05, 1.
*Cload
{loads}
*Restart, write, frequency=0
*Output, field, variable=PRESELECT
*End Step
** ----------------------------------------------------------------
**
** STEP: Modes
**
*Step, name=Modes, nlgeom=NO, perturbation
*Frequency, eigensolver=Lanczos, normalization=mass
10, , , , ,
*Output, field, variable=PRESELECT
*End Step
"""


@dataclass(frozen=True)
class BrakeReuss:
    """Lengths in mm, and numbers of cells."""

    length: float = option(420.0, "of each half")
    lap: float = option(120.0, "of the lap, three bolts long")
    width: float = option(25.0, "and height of the beam")
    hole: float = option(8.6, "diameter of the holes")
    shank: float = option(8.0, "diameter of the bolts")
    head: float = option(13.0, "diameter of heads and nuts")
    washer: float = option(16.0, "diameter of the washers")
    head_height: float = option(5.3, "of the heads")
    nut_height: float = option(6.5, "of the nuts")
    washer_height: float = option(1.6, "of the washers")
    clamping: float = option(9000.0, "force in N to which the bolts are tightened")
    kind: str = option("hex8", "hex8 or hex20", tuple(TYPES))
    around: int = option(3, "cells around a quarter of a hole and across the width")
    radial: int = option(3, "cells from a hole outwards")
    through: int = option(2, "cells through half the beam")
    along: int = option(24, "cells along a half outside the lap")


def parts(beam: BrakeReuss) -> dict[str, Body]:
    """Return the four parts, each in its own axes.  Local.

    Raises
    ------
    ValueError: lengths that turn an element inside out or let parts overlap.
    """
    if not 0.0 < beam.shank < beam.hole < beam.head < beam.washer < min(beam.lap / 3.0, beam.width) or beam.lap >= beam.length:
        raise ValueError(
            "diameters must grow from shank to hole, head, washer, pitch and width, and the lap be shorter than a half"
        )
    bodies = {"HALF_BEAM": _half(beam), "BOLT": _bolt(beam), "NUT": _nut(beam), "WASHER": _washer(beam)}
    if min(jacobian_minimum(body).min() for body in bodies.values()) <= 0.0:
        raise ValueError("these lengths turn elements inside out")
    return bodies


def _half(beam: BrakeReuss) -> Body:
    """Return a half: whole up to the lap, and there its lower part with three holes."""
    h, free, pitch = 0.5 * beam.width, beam.length - beam.lap, beam.lap / 3.0
    cells = _Cells(beam.around, beam.radial, beam.through, beam.along, growth=0.4)
    size, number = (free, beam.width, h), (beam.along, beam.around, beam.through)
    blocks = [box(beam.kind, size, number, (0.0, -h, z), {"x0": "END"}) for z in (-h, 0.0)]
    for i in range(3):
        centre = np.array([free + (i + 0.5) * pitch, 0.0])
        outlines = _circle(0.5 * beam.hole), _rectangle(0.5 * np.array([pitch, beam.width]))
        blocks += _ring(beam.kind, centre, outlines, (-h, 0.0), cells, {"z0": "SEAT", "z1": "LAP"})
    return join(blocks, 1e-6)


def _bolt(beam: BrakeReuss) -> Body:
    """Return a bolt along z: thread, shank in two halves, head."""
    top = 0.5 * beam.width + beam.washer_height
    flat = _Cells(beam.around, 1, 1, 0)
    edges = [_circle(0.5 * diameter) for diameter in (beam.shank, beam.hole, beam.head)]
    core, blocks = _rectangle(np.full(2, 0.2 * beam.shank)), []
    for z, n, inside, outside in (
        ((-top - beam.nut_height, -top), 2, {}, {"x1": "THREAD"}),
        ((-top, 0.0), 2, {"z1": "CUT"}, {"z1": "CUT"}),
        ((0.0, top), 2, {}, {}),
        ((top, top + beam.head_height), 2, {}, {}),
    ):
        corner, size = (-0.2 * beam.shank, -0.2 * beam.shank, z[0]), (0.4 * beam.shank, 0.4 * beam.shank, z[1] - z[0])
        blocks.append(box(beam.kind, size, (beam.around, beam.around, n), corner, inside))
        cells = _Cells(flat.around, 1, n, 0)
        blocks += _ring(beam.kind, np.zeros(2), (core, edges[0]), z, cells, outside)
        if z[0] == top:
            blocks += _ring(beam.kind, np.zeros(2), edges[:2], z, cells, {})
            blocks += _ring(beam.kind, np.zeros(2), edges[1:], z, cells, {"z0": "UNDERHEAD"})
    return join(blocks, 1e-6)


def _nut(beam: BrakeReuss) -> Body:
    """Return a nut whose upper face lies at z = 0."""
    edges = [_circle(0.5 * diameter) for diameter in (beam.shank, beam.hole, beam.head)]
    cells, z = _Cells(beam.around, 1, 2, 0), (-beam.nut_height, 0.0)
    inner = _ring(beam.kind, np.zeros(2), edges[:2], z, cells, {"x0": "THREAD"})
    return join(inner + _ring(beam.kind, np.zeros(2), edges[1:], z, cells, {"z1": "FACE"}), 1e-6)


def _washer(beam: BrakeReuss) -> Body:
    """Return a washer that lies on z = 0."""
    cells = _Cells(beam.around, 2, 1, 0)
    edges = _circle(0.5 * beam.hole), _circle(0.5 * beam.washer)
    names = {"z0": "LOWER", "z1": "UPPER"}
    return join(_ring(beam.kind, np.zeros(2), edges, (0.0, beam.washer_height), cells, names), 1e-6)


def input_file(beam: BrakeReuss) -> str:
    """Return the text of the input file.  Local."""
    bodies = parts(beam)
    lines = ["*Heading", "** A bolted beam of two halves, in mm, t and s", "*Preprint, echo=NO, model=NO, history=NO, contact=NO"]
    lines += ["**", "** PARTS", "**"]
    for name, body in bodies.items():
        lines += _part(name, body)
    lines += ["**", "** ASSEMBLY", "**", "*Assembly, name=Assembly", "**"]
    lines += _instances(beam)
    lines += _named_in_the_assembly(beam, bodies["HALF_BEAM"])
    lines += _connections()
    loads = "\n".join(f"PRETENSION-{i}, 1, {beam.clamping:g}" for i in (1, 2, 3))
    return "\n".join([*lines, "*End Assembly", "**", "** MATERIALS", "**", AFTER_THE_ASSEMBLY.format(loads=loads)])


def _part(name: str, body: Body) -> list[str]:
    """Return a part with its elements' set, its section and its surfaces."""
    lines = [f"*Part, name={name}", "*Node"]
    lines += [f"{i:7d}, {x:13.6f}, {y:13.6f}, {z:13.6f}" for i, (x, y, z) in enumerate(body.points, 1)]
    lines += [f"*Element, type={TYPES[body.kind]}", *_rows([[i, *nodes] for i, nodes in enumerate(body.elements + 1, 1)])]
    lines += [
        f"*Nset, nset=ALL, generate\n  1, {len(body.points)}, 1",
        f"*Elset, elset=ALL, generate\n  1, {len(body.elements)}, 1",
    ]
    for surface, by_face in _surfaces(body).items():
        for face, numbers in by_face.items():
            lines += [f"*Elset, elset=_{surface}_{face}, internal", *_rows([numbers])]
        lines += [f"*Surface, type=ELEMENT, name={surface}", *(f"_{surface}_{face}, {face}" for face in by_face)]
    return [*lines, f"** Section: {name}", "*Solid Section, elset=ALL, material=STEEL", ",", "*End Part", "**"]


def _surfaces(body: Body) -> dict[str, dict[str, list[int]]]:
    """Return the elements of each named surface by their face."""
    places = {}
    for (i, nodes), (k, face) in itertools.product(enumerate(body.elements, 1), enumerate(FACES, 1)):
        places.setdefault(tuple(sorted(nodes[list(face)])), (i, f"S{k}"))
    surfaces: dict[str, dict[str, list[int]]] = {}
    for name, faces in body.faces.items():
        for nodes in np.concatenate([own[:, :4] for own in faces]):
            element, face = places[tuple(sorted(nodes))]
            surfaces.setdefault(name, {}).setdefault(face, []).append(element)
    return surfaces


def _rows(records: list[list[int]]) -> list[str]:
    """Return records of integers, 16 a line; continued lines end in a comma."""
    lines = []
    for record in records:
        pieces = [record[i : i + 16] for i in range(0, len(record), 16)]
        lines += [", ".join(f"{number:5d}" for number in piece) + "," * (piece is not pieces[-1]) for piece in pieces]
    return lines


def _instances(beam: BrakeReuss) -> list[str]:
    """Return the instances: halves, bolts, washers and nuts."""
    whole, h = 2.0 * beam.length - beam.lap, 0.5 * beam.width
    lines = ["*Instance, name=HALF_BEAM-1, part=HALF_BEAM", "*End Instance", "**"]
    lines += ["*Instance, name=HALF_BEAM-2, part=HALF_BEAM", f"{whole:g}, 0., 0."]
    lines += [f"{whole:g}, 0., 0., {whole:g}, 1., 0., 180.", "*End Instance", "**"]
    low, count = -h - beam.washer_height, {"BOLT": 0, "WASHER": 0, "NUT": 0}
    for i in range(3):
        x = beam.length - beam.lap + (i + 0.5) * beam.lap / 3.0
        for part, z in (("BOLT", 0.0), ("WASHER", h), ("WASHER", low), ("NUT", low)):
            count[part] += 1
            lines += [f"*Instance, name={part}-{count[part]}, part={part}", f"{x:g}, 0., {z:g}", "*End Instance", "**"]
    return lines


def _named_in_the_assembly(beam: BrakeReuss, half: Body) -> list[str]:
    """Return reference points, sets and surfaces that belong to the assembly."""
    whole = 2.0 * beam.length - beam.lap
    lines = ["*Node", f"1, {whole + 5.0:g}, 0., 0."]
    lines += [f"{i + 1}, {beam.length - beam.lap + (i - 0.5) * beam.lap / 3.0:g}, 0., 0." for i in (1, 2, 3)]
    lines += ["*Nset, nset=RP-1", "1,", *(line for i in (1, 2, 3) for line in (f"*Nset, nset=PRETENSION-{i}", f"{i + 1},"))]
    lines += ["*Element, type=MASS, elset=SENSOR_MASS", "1, 1", "*Mass, elset=SENSOR_MASS", "2e-05,"]
    lines += ["*Nset, nset=CLAMPED, instance=HALF_BEAM-1", *_rows([list(half.face_nodes("END") + 1)])]
    for name, instance in (("LAP_LOWER", "HALF_BEAM-1"), ("LAP_UPPER", "HALF_BEAM-2")):
        by_face = _surfaces(half)["LAP"]
        for face, numbers in by_face.items():
            lines += [f"*Elset, elset=_{name}_{face}, internal, instance={instance}", *_rows([numbers])]
        lines += [f"*Surface, type=ELEMENT, name={name}", *(f"_{name}_{face}, {face}" for face in by_face)]
    return lines


def _connections() -> list[str]:
    """Return ties, the coupling of the sensor and the cuts."""
    lines = ["** Constraint: SENSOR", "*Coupling, constraint name=SENSOR, ref node=RP-1, surface=HALF_BEAM-2.END", "*Kinematic"]
    for i in (1, 2, 3):
        upper, lower = 2 * i - 1, 2 * i
        for slave, master in (
            (f"WASHER-{upper}.LOWER", "HALF_BEAM-2.SEAT"),
            (f"WASHER-{lower}.UPPER", "HALF_BEAM-1.SEAT"),
            (f"BOLT-{i}.UNDERHEAD", f"WASHER-{upper}.UPPER"),
            (f"NUT-{i}.FACE", f"WASHER-{lower}.LOWER"),
            (f"NUT-{i}.THREAD", f"BOLT-{i}.THREAD"),
        ):
            name = f"{slave.replace('.', '_')}"
            lines += [f"** Constraint: {name}", f"*Tie, name={name}, adjust=yes, type=SURFACE TO SURFACE", f"{slave}, {master}"]
        lines += [f"*Pre-tension Section, surface=BOLT-{i}.CUT, node=PRETENSION-{i}", "0., 0., 1."]
    return lines


def main(arguments=None) -> None:
    """Write the requested file and print a summary."""
    parser = parser_of(__doc__, ".inp")
    add_options(parser, BrakeReuss)
    given = vars(parser.parse_args(arguments))
    beam = BrakeReuss(**named(given, BrakeReuss))
    try:
        text = input_file(beam)
        with open(given["out"], "w", encoding="ascii") as file:
            file.write(text)
    except (ValueError, OSError) as problem:
        parser.exit(2, f"{parser.prog}: {problem}\n")
    for name, body in parts(beam).items():
        print(f"{name:10s} {len(body.points):5d} nodes, {len(body.elements):5d} {TYPES[body.kind]}")


if __name__ == "__main__":
    main()
