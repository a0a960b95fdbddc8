"""Bad discs: cyclic faces, numbers of sectors, waves, supports, joints to the next sector."""

from __future__ import annotations

from pathlib import Path

from .case import Case, appended, edited

RUN = "run disc.toml --out out"
FACES, WAVE, SHROUDS = 'faces = ["low0", "high0"]', "engine_order = 1", '"shroud_high", "shroud_low"]'
TABLE = f"[cyclic]\nsectors = 5\naxis = [0.0, 0.0, 1.0]\n{FACES}\n{WAVE}\n"
CORE = '[bodies.core]\ngroup = "core"\nmaterial = "steel"\n[[supports]]'
LAWS = "friction = 0.3\ntangential_stiffness = 5.0e11\nnormal_stiffness = 1.0e12\npreload = 2.0e6\n"


def disc(name: str, old: str, new: str, *words: str) -> Case:
    """Return the scene of the disc with a replaced text."""
    return Case(name, RUN, words, edited("disc.toml", old, new))


def faces(low: str, high: str) -> str:
    return f'faces = ["{low}", "{high}"]'


FIT = [
    disc("faces swapped", FACES, faces("high0", "low0"), "[cyclic] faces: turned by 360/5", "swap the two faces"),
    disc("axis reversed", "axis = [0.0, 0.0, 1.0]", "axis = [0.0, 0.0, -1.0]", "swap the two faces", "or reverse the axis"),
    disc("sectors that do not fit", "sectors = 5", "sectors = 6", "they lie 72 degrees apart, which is that of 5 sectors"),
    disc("faces of two kinds", FACES, faces("low0", "shroud_high"), "the worst is node 1 of 'low0' at (0.05, 0, 0) m"),
    disc("axis elsewhere", FACES, FACES + "\naxis_point = [0.01, 0.0, 0.0]", "the worst is node", "check axis and axis_point"),
    disc("face with a node moved", "disc.msh", "bent.msh", "1 of 4 nodes of 'high0'", "the worst is node 16 of 'high0'"),
    disc("faces that share nodes", FACES, faces("low0", "bore"), "share 2 nodes", "a node off the axis lies on one of the two"),
    Case(
        "nodes on the axis",
        RUN,
        ("share 2 nodes, the first is node 41 at (0, 0, 0) m", "leave a small bore"),
        edited("disc.toml", "disc.msh", "pie.msh", "[[supports]]", CORE, FACES, faces("pie_low", "pie_high")),
    ),
    disc("a face of no group", FACES, faces("low0", "hihg0"), "[cyclic] faces = 'hihg0'", "nearest is 'high0'"),
    disc("the same face twice", FACES, faces("low0", "low0"), "two groups of the mesh, [low, high]"),
]

WAVES = [
    disc("engine order without sectors", TABLE, WAVE + "\n", "engine_order: unknown key; [cyclic]"),
    disc("no number of sectors", "sectors = 5\n", "", "[cyclic] sectors is missing"),
    disc("one sector", "sectors = 5", "sectors = 1", "a whole number of at least 2"),
    disc("no wave", WAVE, "", "exactly one of engine_order, nodal_diameter"),
    disc("two waves", WAVE, WAVE + "\nnodal_diameter = 1", "found engine_order and nodal_diameter"),
    disc("engine order of a half", WAVE, "engine_order = 1.5", "[cyclic] engine_order = 1.5", "a whole number"),
    disc(
        "nodal diameter above half", WAVE, "nodal_diameter = 3", "above half of 5", "that of 2, the wave in the other direction"
    ),
    disc("nodal diameter beyond", WAVE, "nodal_diameter = 7", "above half of 5", "that of 2, the same wave"),
    disc("wave without a direction", WAVE, "nodal_diameter = 2", "wave is missing", '"backward"', '"forward"'),
    disc("wave of another word", WAVE, 'nodal_diameter = 2\nwave = "back"', '[cyclic] wave = "back"'),
    disc("wave of an engine order", WAVE, WAVE + '\nwave = "forward"', "wave belongs to nodal_diameter"),
    Case(
        "modes of a nodal diameter above half", "modes disc.toml --out out --diameters 3", ("nodal diameters 0 to 2", "that of 2")
    ),
    disc(
        "a base of a disc", "[damping]", "[[loads]]\nbase_acceleration = [1.0, 0.0, 0.0]\n[damping]", "not a wave of the sectors"
    ),
]

SUPPORTED = [
    disc(
        "support of the low face", '"bore"', '"low0"', "break the symmetry", "node 1", "along xyz, its partner 13 along nothing"
    ),
    disc("support of the dependent face", '"bore"', '"high0"', "break the symmetry", "along nothing, its partner 13 along xyz"),
    disc("support along one axis", '["x", "y", "z"]', '["x"]', "break the symmetry", "is fixed along x, its partner 13 along x"),
    Case(
        "point on the dependent face",
        RUN,
        ("4 nodes of the high face of [cyclic] belong to a tie, a point or an equation",),
        appended("disc.toml", '[[points]]\nname = "p"\nposition = [0.0, 0.0, 0.0]\ngroup = "high0"\n'),
    ),
]

JOINTS = [
    Case(
        "disc that turns about another axis",
        RUN,
        ("[model] axis: a disc turns about the axis of [cyclic]",),
        edited("disc.toml", "[model]\n", "[statics]\nrotation_speed = 100.0\n[model]\naxis = [1.0, 0.0, 0.0]\n"),
    ),
    Case(
        "stability of one sector",
        RUN,
        ("[response] stability = true: a disturbance need not be a wave", "state [cyclic] whole = true"),
        edited("disc.toml", "[response]\n", "[response]\nstability = true\n"),
    ),
    disc("next sector without a disc", TABLE, "", '[[joints]] 2 ("shrouds") next_sector: there is no table [cyclic]'),
    disc(
        "next sector without a neighbour", SHROUDS, '"shroud_high", "left0"]', "joint 'shrouds'", "is taken from the next sector"
    ),
    disc("next sector the wrong way", SHROUDS, '"shroud_low", "shroud_high"]', "perhaps ['shroud_high', 'shroud_low']"),
    disc(
        "shrouds of one sector",
        "next_sector = true\n",
        "",
        'state surfaces = ["shroud_high", "shroud_low"] and next_sector = true',
    ),
    disc("next sector of the ground", SHROUDS, '"shroud_high"]\nagainst = "ground"', "next_sector = true: the next sector is"),
    Case(
        "joint on the faces of sectors",
        RUN,
        ("1 face of 'low0' is also of 'low0' of joint 'cut'", "the sectors are one body"),
        appended("disc.toml", f'[[joints]]\nname = "cut"\nsurfaces = ["high0", "low0"]\nnext_sector = true\n{LAWS}'),
    ),
    Case(
        "sectors without a connection",
        RUN,
        ("[cyclic] faces is missing", "no joint has next_sector"),
        edited("disc.toml", FACES, "", SHROUDS, '"left0"]\nagainst = "ground"', "next_sector = true\n", ""),
    ),
]

WHOLE, SECTOR = WAVE + "\nwhole = true", "[[cyclic.sector]]\nnumber = 1\n"


def table_of(*rows: str) -> Case:
    """Return the scene of the disc with a CSV file of factors; the last two texts are the name and the message."""
    *lines, name, words = rows

    def spoil(folder: Path) -> None:
        (folder / "sectors.csv").write_text("\n".join(lines) + "\n")
        edited("disc.toml", WAVE, WHOLE + '\ntable = "sectors.csv"')(folder)

    return Case(name, RUN, (words,), spoil)


def differing(name: str, more: str, *words: str) -> Case:
    """Return the scene of a disc whose sectors may differ, with further keys of its table."""
    return disc(name, WAVE, f"{WHOLE}\n{more}", *words)


DIFFER = [
    disc(
        "factors of one sector for all",
        WAVE,
        f"{WAVE}\n{SECTOR}friction = 0.5",
        "sector states how sectors differ",
        "whole = true",
    ),
    differing("sector beyond the last", "[[cyclic.sector]]\nnumber = 5", "sector 5 is stated; 5 sectors have the numbers 0 to 4"),
    differing("sector stated twice", SECTOR + SECTOR, "sector 1 is stated twice"),
    differing(
        "factor of a sector unknown",
        SECTOR + "frictoin = 0.5",
        '[[cyclic.sector]] 1 frictoin: unknown key; nearest is "friction"',
    ),
    differing("factor below 0", SECTOR + "stiffness = -0.5", "[[cyclic.sector]] 1 stiffness = -0.5", "a number above 0"),
    differing("scatter without a seed", "scatter = { friction = 0.1 }", "[cyclic] scatter seed is missing"),
    differing("scatter of an unknown factor", "scatter = { stifness = 0.1, seed = 1 }", 'nearest is "stiffness"'),
    differing(
        "scatter that makes a stiffness negative",
        "scatter = { stiffness = 0.9, seed = 1 }",
        "[cyclic] scatter: stiffness = 0.9 makes stiffness of sector",
        "it must be above 0: state a smaller one",
    ),
    differing("scatter and sectors", "scatter = { load = 0.1, seed = 1 }\n" + SECTOR, "found sector and scatter"),
    differing("blades of no body", 'blades = ["blad"]', "[cyclic] blades: there is no body 'blad'", 'nearest is "blade"'),
    differing("missing table", 'table = "none.csv"', "[cyclic] table", "none.csv"),
    Case(
        "output named as that of a sector",
        RUN,
        ("[[outputs]] name = 'tip 1': with [cyclic] whole = true", "state another one"),
        edited(
            "disc.toml",
            WAVE,
            WHOLE,
            "[damping]",
            '[[outputs]]\nname = "tip 1"\nposition = [0.1, 0.0, 0.0]\ndirection = [1.0, 0.0, 0.0]\n[damping]',
        ),
    ),
    Case(
        "whole disc by another method",
        RUN,
        ('[solver] method = "adaptive": with [cyclic] whole = true take "receptance"',),
        edited("disc.toml", WAVE, WHOLE, "modes = 8", 'modes = 8\nmethod = "adaptive"'),
    ),
    Case(
        "whole disc with ratios of modes by number",
        RUN,
        ("[damping] ratios: with [cyclic] whole = true", "state ratio, or rayleigh"),
        edited("disc.toml", WAVE, WHOLE, "ratio = 0.01", "ratios = [0.01]"),
    ),
    differing(
        "friction of a sector with statics",
        SECTOR + "friction = 0.5\n[statics]\nrotation_speed = 100.0",
        "the state of rest is that of alike sectors, and friction of a sector takes part in it",
    ),
    table_of("sector,friction", "0,1.0", "1,0.9", "table with too few sectors", "sectors.csv: sector 2 has no row (3 in all)"),
    table_of(
        "sector,friction",
        "0,1.0",
        "1,0.9",
        "1,0.8",
        "table with a sector twice",
        "sectors.csv: sector 1 has two rows and sector 2 has no row (3 in all)",
    ),
    table_of("sector,friction", "7,1.0", "table of a sector beyond", "line 2: sector 7; 5 sectors have the numbers 0 to 4"),
    table_of("sector,frction", "0,1.0", "table of an unknown factor", '"frction" is unknown'),
    table_of(
        "sector,density",
        *(f"{s},{s - 2.0}" for s in range(5)),
        "table with a factor below 0",
        "makes density of sector 0 -2 times",
    ),
]

STUDIES = [
    Case("export of a disc", "export disc.toml --out out", ("[cyclic]: export", "those of a nodal diameter are complex")),
    Case(
        "identification on a disc",
        "identify disc.toml m.csv --out out --fit joints.root.friction=0.1:0.6",
        ("[cyclic]: identify is for structures that are modelled in full",),
    ),
    Case(
        "trade of a whole disc",
        "trade disc.toml --out out",
        ("whole = true: trade measures a disc by one sector",),
        edited("disc.toml", WAVE, WAVE + "\nwhole = true"),
    ),
    Case(
        "verify of a disc by another method",
        "verify disc.toml --out out",
        ("verify integrates all sectors of a disc", 'take "receptance"'),
        edited("disc.toml", "modes = 8", 'modes = 8\nmethod = "adaptive"'),
    ),
]

CASES = [*FIT, *WAVES, *SUPPORTED, *JOINTS, *DIFFER, *STUDIES]
