"""Bad model files, and scenes that do not fit their model file: groups, surfaces, supports, positions."""

from __future__ import annotations

from pathlib import Path

from .case import NOISE, Case, Spoil, all_of, appended, cut, edited, forbidden, made_a_folder, made_a_loop, removed, written
from .sound import MODELS

RUN = "run lap.toml --out out"


def mesh(name: str, spoil: Spoil, *words: str) -> Case:
    """Return the scene of the lap joint with a spoiled mesh."""
    return Case(name, RUN, words, spoil)


def lap(name: str, old: str, new: str, *words: str) -> Case:
    return Case(name, RUN, words, edited("lap.toml", old, new))


def with_more(name: str, text: str, *words: str) -> Case:
    return Case(name, RUN, words, appended("lap.toml", text))


def node(number: int, words: str) -> Spoil:
    """Return a function that replaces the coordinates of a node of lap.msh."""

    def spoil(folder: Path) -> None:
        lines = (folder / "lap.msh").read_text().splitlines()
        row = lines.index("$Nodes") + 1 + number
        lines[row] = f"{lines[row].split()[0]} {words}"
        (folder / "lap.msh").write_text("\n".join(lines) + "\n")

    return spoil


def volume(change) -> Spoil:
    """Return a function that changes the words of the first hexahedron of lap.msh: number, kind, tags, nodes."""

    def spoil(folder: Path) -> None:
        lines = (folder / "lap.msh").read_text().splitlines()
        row = next(row for row in range(lines.index("$Elements") + 2, len(lines)) if lines[row].split()[1] == "5")
        lines[row] = " ".join(change(lines[row].split()))
        (folder / "lap.msh").write_text("\n".join(lines) + "\n")

    return spoil


def to_msh(file: str, content: str = "solid x\nendsolid x\n") -> Spoil:
    """Return a function that writes another file and names it as the mesh."""
    return all_of(edited("lap.toml", "lap.msh", file), written(file, content))


GMSH = [
    mesh("mesh missing", removed("lap.msh"), '[model] mesh = "lap.msh": there is no such file'),
    mesh(
        "mesh in no folder",
        edited("lap.toml", "lap.msh", "meshes/lap.msh"),
        '[model] mesh = "meshes/lap.msh": there is no folder',
    ),
    mesh("mesh is a folder", made_a_folder("lap.msh"), '[model] mesh = "lap.msh": that is a folder; a file is expected'),
    mesh("mesh is a loop of links", made_a_loop("lap.msh"), '[model] mesh = "lap.msh": that is a symbolic link to lap.msh'),
    Case("mesh not to be read", RUN, ("lap.msh", "Permission denied"), forbidden("lap.msh"), not_by_root=True),
    mesh("mesh empty", written("lap.msh", ""), "lap.msh: the file is empty"),
    mesh("mesh of noise", written("lap.msh", NOISE), "lap.msh", "not a Gmsh file"),
    mesh("mesh cut", cut("lap.msh"), "lap.msh", "truncated"),
    mesh("mesh is a scene", written("lap.msh", "[model]\n"), "lap.msh", "not a Gmsh file"),
    mesh("mesh of another kind", to_msh("lap.stl"), "lap.stl: the ending '.stl' is not known; known are .msh"),
    mesh("mesh without an ending", to_msh("lap"), "lap: the name has no ending"),
    mesh("mesh of a version to come", edited("lap.msh", "2.2 0 8", "9.9 0 8"), "lap.msh", "9.9"),
    mesh(
        "mesh of no elements",
        edited("lap.msh", "$Elements", "$Nothing", "$EndElements", "$EndNothing"),
        "lap.msh",
        "the file has no $Elements section",
    ),
    mesh(
        "mesh of no groups",
        edited("lap.msh", "$PhysicalNames", "$Nothing", "$EndPhysicalNames", "$EndNothing"),
        "lap.msh",
        "group",
    ),
    mesh("more nodes announced than present", edited("lap.msh", "$Nodes\n", "$Nodes\n9"), "lap.msh"),
    mesh("node of nan", node(5, "nan 0.0 0.0"), "lap.msh", "not a finite number", "node 5 at"),
    Case("check of a node of nan", "check lap.toml", ("lap.msh", "not a finite number", "node 5 at"), node(5, "nan 0.0 0.0")),
    mesh("node far away", node(5, "1e300 0.0 0.0"), "lap.msh"),
    mesh("node of two coordinates", node(5, "0.0 0.0"), "lap.msh"),
    mesh("node of words", node(5, "zero zero zero"), "lap.msh"),
    mesh(
        "element turned inside out",
        volume(lambda words: [*words[:-8], *words[-4:], *words[-8:-4]]),
        "lap.msh",
        "inverted or collapsed",
        "det J = -",
    ),
    mesh("element of one node eight times", volume(lambda words: [*words[:-8], *8 * [words[-1]]]), "lap.msh"),
    mesh("element of a missing node", volume(lambda words: [*words[:-1], "99999"]), "lap.msh", "99999"),
    mesh("element of seven nodes", volume(lambda words: words[:-1]), "lap.msh"),
    mesh("element of an unknown kind", volume(lambda words: [words[0], "199", *words[2:]]), "lap.msh", "199"),
]

_TRUNCATED = {"inp": 0.3, "cdb": 0.5, "bdf": 0.3, "unv": 0.5, "exo": 0.5, "e": 0.5, "vtu": 0.5}
OTHERS = [
    Case(f".{ending} {what}", f"run bar_{ending}.toml --out out", (f"bar.{ending}", *words), spoil(f"bar.{ending}"))
    for ending in MODELS
    for what, spoil, words in (
        ("missing", removed, ("there is no such file",)),
        ("is a folder", made_a_folder, ("that is a folder; a file is expected",)),
        ("empty", lambda file: written(file, ""), ("the file is empty",)),
        ("of noise", lambda file: written(file, NOISE), ()),
        ("cut", lambda file: cut(file, _TRUNCATED[file.split(".")[1]]), ()),
        ("is a scene", lambda file: written(file, '[model]\nmesh = "x"\n'), ()),
    )
]

STATED = [
    Case("*NODE of words", "run bar_inp.toml --out out", ("bar.inp", "line"), edited("bar.inp", "*Node\n1, ", "*Node\n1, x")),
    Case("*ELEMENT of an unknown type", "run bar_inp.toml --out out", ("bar.inp", "C3D8Z"), edited("bar.inp", "C3D8I", "C3D8Z")),
    Case(
        "*INCLUDE of no file",
        "run bar_inp.toml --out out",
        ("none.inp",),
        edited("bar.inp", "*Heading", "*Include, input=none.inp\n*Heading"),
    ),
    Case("*MATERIAL missing", "run bar_inp.toml --out out", ("Steel",), edited("bar.inp", "name=Steel", "name=Iron")),
    Case("*ELASTIC negative", "run bar_inp.toml --out out", ("young",), edited("bar.inp", "*Elastic\n", "*Elastic\n-")),
    Case(
        "*BOUNDARY of no set",
        "run bar_inp.toml --out out",
        ("PLATE_BSE",),
        edited("bar.inp", "PLATE_BASE, PINNED", "PLATE_BSE, PINNED"),
    ),
    Case(
        "keyword that changes the answer",
        "run bar_inp.toml --out out",
        ("bar.inp", "line"),
        edited("bar.inp", "*Boundary", "*Friction Welding\n1., 2.\n*Boundary"),
    ),
    Case("GRID of words", "run bar_bdf.toml --out out", ("bar.bdf",), edited("bar.bdf", "GRID*,101,,", "GRID*,101,,x")),
    Case(
        "CHEXA of a missing node",
        "run bar_bdf.toml --out out",
        ("bar.bdf", "99999"),
        edited("bar.bdf", "CHEXA,1,1,101", "CHEXA,1,1,99999"),
    ),
    Case(
        "no MAT1",
        "run bar_bdf.toml --out out",
        ("[bodies.PSOLID 1] material", "MAT1 77"),
        edited("bar.bdf", "PSOLID,1,1", "PSOLID,1,77"),
    ),
    Case(
        "NBLOCK of words",
        "run bar_cdb.toml --out out",
        ("bar.cdb: line 10: NBLOCK holds", "where numbers are expected"),
        edited("bar.cdb", "0.0000000000000E+00", "0.00000x0000000E+00"),
    ),
    Case(
        "file of no materials",
        "run bar_inp.toml --out out",
        ("material",),
        edited("bar_inp.toml", 'mesh = "bar.inp"', 'mesh = "bar.inp"\ntake = ["bodies"]'),
    ),
    Case(
        "unknown word to ignore",
        "run bar_inp.toml --out out",
        ("*FOO",),
        edited("bar_inp.toml", 'mesh = "bar.inp"', 'mesh = "bar.inp"\nignore = ["*FOO"]'),
    ),
]

ALONG = "direction = [0.0, 0.0, 1.0]\n"
POINT = '[[points]]\nname = "p"\nposition = [0.3, 0.0, 0.0]\ngroup = "tip"\n'
GROUPS = [
    lap("body of no group", 'group = "beam_1"', 'group = "beam"', "[bodies.left] group = 'beam'", "beam_1"),
    lap("body of faces", 'group = "beam_1"', 'group = "tip"', "[bodies.left] group = 'tip'"),
    lap("support of no group", '"clamp"', '"clmp"', "[[supports]] 1 group = 'clmp'", "nearest is 'clamp'", "it has: "),
    lap("joint of no group", '"lap_2"]', '"lap_3"]', "'lap_3'", "nearest is 'lap_2'"),
    lap("joint of a body", '"lap_2"]', '"beam_2"]', "'beam_2'"),
    lap("load on no group", 'group = "tip"', 'group = "tpi"', "[[loads]] 1 group = 'tpi'", "nearest is 'tip'"),
    lap("load on no node", 'group = "tip"', "node = 99999", "[[loads]] 1", "99999"),
    lap("load in the air", 'group = "tip"', "position = [1.0, 1.0, 1.0]", "[[loads]] 1", "from the nearest node"),
    lap("output at no node", "position = [0.21, 0.0, 0.0]", "node = 99999", "'tip'", "99999"),
    lap("output in millimetres", "[0.21, 0.0, 0.0]", "[210.0, 0.0, 0.0]", "[[outputs]] 'tip' position", "from the nearest node"),
    with_more("tie of no group", '[[ties]]\nsurfaces = ["tip", "nothing"]\n', "[[ties]] 'tip to nothing' surfaces = 'nothing'"),
    with_more(
        "tie of distant surfaces",
        '[[ties]]\nname = "glue"\nsurfaces = ["clamp", "tip"]\n',
        "tie 'glue'",
        "4 of 4 nodes of 'clamp'",
        "the nearest is node 2",
    ),
    with_more("tie on a joint", '[[ties]]\nname = "glue"\nsurfaces = ["lap_1", "lap_2"]\n', "of joint 'lap'"),
    with_more("point of no group", POINT.replace('"tip"', '"tpi"'), "[[points]] 'p' group = 'tpi'", "nearest is 'tip'"),
    with_more("mass on no group", '[[masses]]\ngroup = "tpi"\nmass = 1.0\n', "[[masses]] 1", "'tpi'"),
    with_more("spring on no group", '[[springs]]\ngroups = ["tpi"]\nstiffness = 1.0\n' + ALONG, "[[springs]] 1", "'tpi'"),
    with_more(
        "spring between two groups",
        '[[springs]]\ngroups = ["tip", "clamp"]\nstiffness = 1.0\n',
        "[[springs]] 1 groups",
        "a spring has one at each end",
    ),
    with_more("pressure on a body", '[[loads]]\ngroup = "beam_1"\npressure = 1.0\n', "a pressure acts on faces"),
    with_more(
        "bolt through the outside",
        '[statics]\n[[statics.bolts]]\ngroup = "tip"\nforce = 1.0\n',
        "bolt",
        "'tip'",
        "are not between two elements",
    ),
    with_more(
        "bolt of no group", '[statics]\n[[statics.bolts]]\ngroup = "shank"\nforce = 1.0\n', "[[statics.bolts]] 1", "'shank'"
    ),
    with_more(
        "constant force on no group",
        '[statics]\n[[statics.forces]]\ngroup = "tpi"\nforce = [1.0, 0.0, 0.0]\n',
        "[[statics.forces]] 1",
        "'tpi'",
    ),
    with_more(
        "constant pressure on no group",
        '[statics]\n[[statics.pressures]]\ngroup = "tpi"\npressure = 1.0\n',
        "[[statics.pressures]] 1",
        "'tpi'",
    ),
    with_more(
        "surface with the name of a group",
        '[[surfaces]]\nname = "tip"\nbodies = ["left", "right"]\n',
        "'tip'",
        "has this name already",
    ),
    with_more(
        "surface of distant bodies",
        '[[surfaces]]\nname = "s"\nbodies = ["left", "right"]\nnormal = [1.0, 0.0, 0.0]\n',
        "[[surfaces]] 's'",
        "no face of",
    ),
]

FIT = [
    lap("joint of distant surfaces", '"lap_2"]', '"clamp"]', "joint 'lap'", "have no partner within", "the worst is node"),
    lap("sides with equal normals", '["lap_1", "lap_2"]', '["tip", "clamp"]', "joint 'lap'"),
    Case(
        "nodes that do not match",
        RUN,
        ("joint 'lap'", "have no partner within"),
        all_of(edited("lap.toml", "preload = 1e6", 'preload = 1e6\npairing = "nodes"'), node(18, "0.1199 0.0 0.0")),
    ),
    lap(
        "plane with a preload",
        '["lap_1", "lap_2"]',
        '["lap_1"]\nagainst = "plane"\nplane_point = [0.0, 0.0, 0.0]\nplane_normal = [0.0, 0.0, 1.0]',
        '[[joints]] 1 ("lap")',
        "a gap from the geometry with preload = 1000000.0",
    ),
    lap(
        "plane behind the surface",
        '["lap_1", "lap_2"]\nfriction = 0.3\ntangential_stiffness = 1e12\nnormal_stiffness = 1e12\npreload = 1e6',
        '["lap_2"]\nagainst = "plane"\nplane_point = [0.0, 0.0, 1.0]\nplane_normal = [0.0, 0.0, 1.0]\nfriction = 0.3\ntangential_stiffness = 1e12\nnormal_stiffness = 1e12',
        "joint 'lap'",
    ),
    lap(
        "unsupported body",
        '[[joints]]\nname = "lap"\nsurfaces = ["lap_1", "lap_2"]\nfriction = 0.3\ntangential_stiffness = 1e12\nnormal_stiffness = 1e12\npreload = 1e6\n',
        "",
        "nothing holds body 'right'",
    ),
    lap(
        "more modes than DOF", "modes = 5", "modes = 5000", "[solver] modes = 5000: the structure has only", "degrees of freedom"
    ),
    Case(
        "check of more modes than DOF",
        "check lap.toml",
        ("[solver] modes = 5000: the structure has only",),
        edited("lap.toml", "modes = 5", "modes = 5000"),
    ),
    lap("mode far up", "frequencies = [10.0, 1000.0]", "mode = 4000\nspan = [0.9, 1.1]", "[response] mode = 4000"),
    with_more(
        "support on a distributing point",
        POINT + 'connection = "distributing"\n[[supports]]\npoint = "p"\nfix = ["x"]\n',
        "[[supports]] 2",
        "cannot be held",
    ),
    lap(
        "load on supported nodes",
        'group = "tip"',
        'group = "clamp"',
        "lap.toml: [[loads]] 1 acts only on degrees of freedom that a support fixes",
    ),
    lap(
        "parameters missing",
        "friction = 0.3",
        'friction = 0.3\nparameters = "values.csv"',
        'parameters = "values.csv": there is no such file',
    ),
    lap("missing field", "friction = 0.3", 'friction = 0.3\nfields = { preload = "p" }', "joint 'lap'", "'p'"),
]


def values(name: str, text: str, *words: str) -> Case:
    """Return the lap joint with a file of values for its points."""
    stated = edited("lap.toml", "friction = 0.3", 'friction = 0.3\nparameters = "values.csv"')
    return Case(name, RUN, ("values.csv", *words), all_of(stated, written("values.csv", text)))


TABLES = [
    values("values: empty", "", "the file is empty", "names some of the columns node,x,y,z"),
    values("values: no row", "node,friction\n", "after the header"),
    values("values: of noise", "\udcff\udcfe".encode("utf-8", "surrogateescape").decode("latin-1") + "\0", "line"),
    values("values: nan", "node,friction\n1,nan\n", "line 2", "friction = nan is not a finite number"),
    values("values: a word", "node,friction\n1,much\n", "line 2", '"much" is not a number'),
    values("values: a column too few", "node,friction\n1\n", "line 2: 1 values; 2 are needed"),
    values("values: unknown column", "node,mu\n1,0.3\n", "mu"),
    values("values: semicolons", "node;friction\n1;0.3\n", "separated by semicolons"),
    values("values: node not of the joint", "node,friction\n99999,0.3\n", "99999"),
    values("values: negative", "node,friction\n22,-0.3\n", "line 2", "-0.3"),
    values("values: half a node", "node,friction\n1.5,0.3\n", "1.5"),
]

CASES = [*GMSH, *OTHERS, *STATED, *GROUPS, *FIT, *TABLES]
