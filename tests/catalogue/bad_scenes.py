"""Scene files with a single mistake each, which is detected before a model file is opened."""

from __future__ import annotations

from .case import NOISE, Case, appended, edited, forbidden, made_a_folder, made_a_loop, written

RUN = "run lap.toml --out out"


def lap(name: str, old: str, new: str, *words: str) -> Case:
    """Return the scene of the lap joint with a replaced text."""
    return Case(name, RUN, words, edited("lap.toml", old, new))


def with_more(name: str, text: str, *words: str) -> Case:
    """Return the scene of the lap joint with further tables."""
    return Case(name, RUN, words, appended("lap.toml", text))


STATICS = "[statics]\nrotation_speed = 10.0\n"
AXIS = 'mesh = "lap.msh"\naxis = [0.0, 0.0, 1.0]'

FILES = [
    Case("scene missing", "run lop.toml --out out", ("lop.toml", "there is no such file", 'nearest is "lap.toml"')),
    Case("scene in no folder", "run none/lap.toml --out out", ("there is no folder", "none")),
    Case("scene is a folder", RUN, ("lap.toml is a folder; a scene file is expected",), made_a_folder("lap.toml")),
    Case("scene is a loop of links", RUN, ("lap.toml", "symbolic link to lap.toml"), made_a_loop("lap.toml")),
    Case("scene not to be read", RUN, ("lap.toml", "Permission denied"), forbidden("lap.toml"), not_by_root=True),
    Case("scene empty", RUN, ("lap.toml", "[model] is missing"), written("lap.toml", "")),
    Case("scene of noise", RUN, ("lap.toml", "not a text file in UTF-8"), written("lap.toml", NOISE)),
    Case("scene in UTF-16", RUN, ("lap.toml", "not a text file in UTF-8"), written("lap.toml", "title = 1".encode("utf-16"))),
    Case("scene too large", RUN, ("lap.toml", "MB are too much for a scene"), written("lap.toml", b"#" * 10_000_001)),
    Case("scene nested too deeply", RUN, ("lap.toml", "too deep"), written("lap.toml", "a = " + 20_000 * "[" + 20_000 * "]")),
    Case("model file for a scene", "run lap.msh --out out", ("lap.msh", "not valid TOML", "microslip new lap.msh")),
    lap("quote not closed", '"lap.msh"', '"lap.msh', "lap.toml", "not valid TOML", "at line 2"),
    lap("no value", "poisson = 0.3", "poisson =", "not valid TOML", "line 5", "poisson ="),
    lap("key twice", "poisson = 0.3", "young = 1.0", "not valid TOML", "line 5"),
    lap("table twice", "[damping]", "[response]", "not valid TOML: Cannot declare [response] twice"),
    lap("comma for a point", "poisson = 0.3", "poisson = 0,3", "not valid TOML", "line 5"),
]

MISSING = [
    lap("no model", '[model]\nmesh = "lap.msh"\n', "", "[model] is missing"),
    lap("no mesh", 'mesh = "lap.msh"', "", "[model]: exactly one of mesh, stiffness is needed, found none"),
    lap("no young", "young = 210e9\n", "", "[materials.steel]: young is missing", "Young's modulus in Pa"),
    lap("no group of a body", 'group = "beam_1"\n', "", "[bodies.left] group is missing"),
    lap("no loads", "[[loads]]", "[[springs]]", "[[loads]]"),
    lap(
        "no outputs",
        '[[outputs]]\nname = "tip"\nposition = [0.21, 0.0, 0.0]\ndirection = [0.0, 0.0, 1.0]\n',
        "",
        "outputs",
        "missing",
    ),
    lap("no damping", "[damping]\nratio = 0.01\n", "", "[damping] is missing"),
    lap("empty damping", "ratio = 0.01", "", "[damping]: exactly one of ratio, rayleigh is needed"),
    lap("no levels", "levels = [1.0]\n", "", "[response] levels is missing", "load levels in N"),
    lap("no range", "frequencies = [10.0, 1000.0]\n", "", "[response]: exactly one of frequencies, mode is needed, found none"),
    lap("stability is no truth", "levels = [1.0]\n", "levels = [1.0]\nstability = 1\n", "[response] stability", "true or false"),
    lap(
        "sensitivities is no truth",
        "levels = [1.0]\n",
        "levels = [1.0]\nsensitivities = 1\n",
        "[response] sensitivities",
        "true or",
    ),
    Case(
        "stability with a loss factor",
        RUN,
        ("[response] stability = true", "loss factor", "no equivalent in time", "about half the loss factor"),
        edited(
            "lap.toml", "levels = [1.0]", "levels = [1.0]\nstability = true", "ratio = 0.01", "ratio = 0.01\nstructural = 0.01"
        ),
    ),
    lap("levels out of range", "levels = [1.0]", "levels = [1e200]", "[response] levels = [1e+200]", "at most 1e100"),
    Case(
        "mode out of range",
        RUN,
        ("[response] mode = 99999: the structure has only",),
        edited("lap.toml", "frequencies = [10.0, 1000.0]", "mode = 99999\nspan = [0.9, 1.1]", "modes = 5\n", ""),
    ),
    lap("mode without span", "frequencies = [10.0, 1000.0]", "mode = 1", "[response]: span is missing"),
    lap("no friction", "friction = 0.3\n", "", '[[joints]] 1 ("lap"): friction is missing'),
    lap("no stiffness", "normal_stiffness = 1e12\n", "", '[[joints]] 1 ("lap"): normal_stiffness is missing', "N/m3"),
    lap("no direction", 'group = "tip"\ndirection = [0.0, 0.0, 1.0]', 'group = "tip"', "[[loads]] 1: direction is missing"),
    lap(
        "no place of a load",
        'group = "tip"\n',
        "",
        "[[loads]] 1: exactly one of position, node, group, dof is needed, found none",
    ),
    lap("no name of an output", 'name = "tip"\n', "", "[[outputs]] 1 name is missing"),
]

UNKNOWN = [
    lap("unknown key of the model", "mesh =", "msh =", '[model] msh: unknown key; nearest is "mesh"'),
    lap("unknown key of a material", "young =", "youngs =", '[materials.steel] youngs: unknown key; nearest is "young"'),
    lap("unknown key of a body", 'group = "beam_1"', 'grp = "beam_1"', '[bodies.left] grp: unknown key; nearest is "group"'),
    lap("unknown key of a support", "fix =", "fixed =", '[[supports]] 1 fixed: unknown key; nearest is "fix"'),
    lap("unknown key of a joint", "friction =", "mu =", '[[joints]] 1 ("lap") mu: unknown key'),
    lap("unknown key of a load", 'group = "tip"', 'set = "tip"', "[[loads]] 1 set: unknown key"),
    lap("unknown key of an output", "position =", "pos =", '[[outputs]] 1 ("tip") pos: unknown key; nearest is "position"'),
    lap("unknown key of the damping", "ratio =", "zeta =", "[damping] zeta: unknown key"),
    lap("unknown key of the response", "points =", "point =", '[response] point: unknown key; nearest is "points"'),
    lap("unknown key of the solver", "modes =", "n_modes =", '[solver] n_modes: unknown key; nearest is "modes"'),
    lap(
        "key of another table", "modes = 5", "levels = [1.0]", "[solver] levels: unknown key", "[response] has a key of this name"
    ),
    lap("unknown table", "[solver]", "[sovler]", "[sovler]: unknown table; nearest is [solver]"),
    with_more(
        "unknown key of the continuation",
        "[continuation]\ndsmin = 0.1\n",
        '[continuation] dsmin: unknown key; nearest is "ds_min"',
    ),
    with_more("unknown key of the statics", "[statics]\nspeed = 1.0\n", "[statics] speed: unknown key"),
    with_more(
        "unknown key of a bolt",
        '[statics]\n[[statics.bolts]]\ncut = "clamp"\nforce = 1.0\n',
        "[[statics.bolts]] 1 cut: unknown key",
    ),
    with_more(
        "unknown key of a tie", '[[ties]]\nsurface = ["tip", "clamp"]\n', '[[ties]] 1 surface: unknown key; nearest is "surfaces"'
    ),
    with_more(
        "unknown key of a point",
        '[[points]]\nname = "p"\nposition = [0.0, 0.0, 0.0]\ngroup = "tip"\nmas = 1.0\n',
        '[[points]] 1 ("p") mas: unknown key; nearest is "mass"',
    ),
    with_more("unknown key of a mass", '[[masses]]\ngroup = "tip"\nm = 1.0\n', "[[masses]] 1 m: unknown key"),
    with_more(
        "unknown key of a spring",
        '[[springs]]\ngroup = ["tip"]\nstiffness = 1.0\n',
        '[[springs]] 1 group: unknown key; nearest is "groups"',
    ),
    with_more(
        "unknown key of a surface",
        '[[surfaces]]\nname = "s"\nbody = ["left", "right"]\n',
        '[[surfaces]] 1 ("s") body: unknown key; nearest is "bodies"',
    ),
]

VALUES = [
    lap("number in quotes", "poisson = 0.3", 'poisson = "0.3"', '[materials.steel] poisson = "0.3"', "without quotes"),
    lap("text for a list", 'fix = ["x", "y", "z"]', 'fix = "xyz"', '[[supports]] 1 fix = "xyz"', "a list of"),
    lap("number for a text", 'group = "clamp"', "group = 3", "[[supports]] 1 group = 3", "the name of a group"),
    lap("nan", "poisson = 0.3", "poisson = nan", "[materials.steel] poisson = nan", "nan and inf are not numbers here"),
    lap("inf", "levels = [1.0]", "levels = [inf]", "[response] levels = [inf]", "nan and inf are not numbers here"),
    lap("fraction of a mode", "modes = 5", "modes = 5.5", "[solver] modes = 5.5", "a whole number of at least 1"),
    lap("logical in quotes", "modes = 5", 'error_bars = "no"', '[solver] error_bars = "no"', "true or false"),
    lap("table for a key", "modes = 5", "[solver.modes]", "[solver] modes = a table", "the number of modes"),
    lap("table in place of a list", "[[loads]]", "[loads]", "loads", "at least one table headed [[loads]]"),
    lap(
        "two numbers of a vector",
        "position = [0.21, 0.0, 0.0]",
        "position = [0.21, 0.0]",
        '[[outputs]] 1 ("tip") position = [0.21, 0.0]',
        "three coordinates",
    ),
    lap("young of 0", "young = 210e9", "young = 0.0", "[materials.steel] young = 0.0", "a number above 0"),
    lap("negative density", "density = 7800.0", "density = -7800.0", "density = -7800.0", "a number above 0"),
    lap("poisson of an incompressible", "poisson = 0.3", "poisson = 0.5", "poisson = 0.5", "below 0.5"),
    lap("negative friction", "friction = 0.3", "friction = -0.3", "friction = -0.3", "a number of at least 0"),
    lap(
        "stiffness of 0",
        "tangential_stiffness = 1e12",
        "tangential_stiffness = 0.0",
        "tangential_stiffness = 0.0",
        "a number above 0",
    ),
    lap("negative preload", "preload = 1e6", "preload = -1e6", "preload = -1e+06", "a number of at least 0"),
    lap("level of 0", "levels = [1.0]", "levels = [0.0]", "[response] levels = [0.0]", "numbers above 0"),
    lap("negative level", "levels = [1.0]", "levels = [1.0, -2.0]", "[response] levels = [1.0, -2.0]", "numbers above 0"),
    lap("level twice", "levels = [1.0]", "levels = [1.0, 1.0]", "[response] levels = [1.0, 1.0]", "each once"),
    lap("no level", "levels = [1.0]", "levels = []", "[response] levels = []", "a list of load levels"),
    lap("range of one frequency", "[10.0, 1000.0]", "[10.0]", "[response] frequencies = [10.0]", "two frequencies"),
    lap("empty range", "[10.0, 1000.0]", "[10.0, 10.0]", "[response] frequencies = [10.0, 10.0]", "the lower one first"),
    lap("range from above", "[10.0, 1000.0]", "[1000.0, 10.0]", "[response] frequencies = [1000.0, 10.0]", "the lower one first"),
    lap("range from 0", "[10.0, 1000.0]", "[0.0, 10.0]", "[response] frequencies = [0.0, 10.0]", "above 0"),
    lap("frequencies out of range", "[10.0, 1000.0]", "[10.0, 1e10]", "[response] frequencies", "at most 1e9"),
    lap(
        "frequency outside the range",
        "points = 20",
        "at = [2000.0]",
        "[response]: at holds 2000 Hz, outside frequencies = [10, 1000]",
    ),
    lap("one point", "points = 20", "points = 1", "[response] points = 1", "a whole number of at least 2"),
    lap("sweep sideways", "points = 20", 'direction = "dwon"', 'direction = "dwon"', 'nearest is "down"'),
    lap("critical damping", "ratio = 0.01", "ratio = 1.0", "[damping] ratio = 1.0", "below 1"),
    lap("negative modes", "modes = 5", "modes = -5", "[solver] modes = -5", "a whole number of at least 1"),
    lap("negative harmonics", "harmonics = 3", "harmonics = -1", "[solver] harmonics = -1", "a whole number of at least 0"),
    lap("harmonics without end", "harmonics = 3", "harmonics = 100000", "[solver] harmonics = 100000", "; at most 10000"),
    lap(
        "harmonics that fall",
        "harmonics = 3",
        "harmonics = [3, 1]",
        "[solver] harmonics = [3, 1]",
        "an ascending list of harmonics",
    ),
    lap("harmonics without the first", "harmonics = 3", "harmonics = [0, 2]", "harmonics = [0, 2] has no harmonic 1"),
    lap("bars of some harmonics", "harmonics = 3", "harmonics = [1, 3]", "state error_bars = false, or harmonics = 3"),
    lap(
        "samples too few",
        "harmonics = 3",
        "harmonics = 20\nsamples = 32",
        "samples = 32 do not resolve harmonics = 20; at least 41 are needed",
    ),
    lap("tolerance of 0", "modes = 5", "tolerance = 0.0", "[solver] tolerance = 0.0", "above 0 and below 1"),
    lap("accuracy of 1", "modes = 5", "accuracy = 1.0", "[solver] accuracy = 1.0", "above 0 and below 1"),
    lap(
        "unknown method",
        "modes = 5",
        'method = "receptanse"',
        'method = "receptanse"',
        'nearest is "receptance"',
        "known: adaptive",
    ),
    lap("unknown law", "friction = 0.3", 'friction = 0.3\nlaw = "coulomb"', 'law = "coulomb"', 'nearest is "elastic-coulomb"'),
    lap(
        "direction of 0",
        "[0.0, 0.0, 1.0]\n[[outputs]]",
        "[0.0, 0.0, 0.0]\n[[outputs]]",
        "[[loads]] 1 direction = [0.0, 0.0, 0.0]",
        "not all 0",
    ),
    lap("axis unknown", '"z"]', '"w"]', "[[supports]] 1 fix", '"x", "y" and "z"'),
    lap("axis twice", '"z"]', '"y"]', "[[supports]] 1 fix", "each once"),
    lap("name with a comma", 'name = "lap"', 'name = "lap, upper"', "[[joints]] 1", "without comma, quote or slash"),
    lap("node below 0", 'group = "tip"', "node = -1", "[[loads]] 1 node = -1", "a whole number of at least 0"),
    with_more(
        "shortest step above the longest",
        "[continuation]\nds_min = 0.1\nds_max = 0.01\n",
        "[continuation]: ds_min = 0.1 is above ds_max = 0.01",
    ),
    with_more("no load steps", STATICS + "steps = 0\n", "[statics] steps = 0", "a whole number of at least 1"),
    with_more(
        "inertia of no body",
        '[[points]]\nname = "p"\nposition = [0.0, 0.0, 0.0]\ngroup = "tip"\ninertia = [1.0, -1.0, 1.0]\n',
        '[[points]] 1 ("p") inertia',
        "never below 0",
    ),
]

CONTRADICTIONS = [
    lap("gap with preload", "preload = 1e6", "preload = 1e6\ngap = 1e-6", "gap = 1e-06 with preload", "keep one"),
    lap("one surface", '["lap_1", "lap_2"]', '["lap_1"]', 'surfaces names one group; name two, or state against = "ground"'),
    lap("one surface twice", '["lap_1", "lap_2"]', '["lap_1", "lap_1"]', "surfaces =", "two different groups"),
    lap("three surfaces", '["lap_1", "lap_2"]', '["lap_1", "lap_2", "tip"]', "surfaces =", "two different groups"),
    lap(
        "pairs with a mesh",
        'surfaces = ["lap_1", "lap_2"]',
        'pairs = "pairs.csv"',
        '[[joints]] 1 ("lap")',
        "belongs to a joint of surfaces; a CSV file states it for each pair",
    ),
    lap(
        "mesh and matrices",
        'mesh = "lap.msh"',
        'mesh = "lap.msh"\nstiffness = "K.mtx"',
        "[model]: exactly one of mesh, stiffness is needed, found mesh and stiffness",
    ),
    lap("stiffness without mass", 'mesh = "lap.msh"', 'stiffness = "K.mtx"', "[model]: mass is missing"),
    lap(
        "scale and units",
        'mesh = "lap.msh"',
        'mesh = "lap.msh"\nscale = 0.001\nunits = "mm-t-s"',
        "units states the length already",
    ),
    lap(
        "range and mode",
        "points = 20",
        "mode = 1\nspan = [0.9, 1.1]",
        "exactly one of frequencies, mode is needed, found frequencies and mode",
    ),
    lap(
        "mode beyond the modes",
        "frequencies = [10.0, 1000.0]",
        "mode = 9\nspan = [0.9, 1.1]",
        "[response] mode = 9: only [solver] modes = 5 are computed",
    ),
    lap("load at two places", 'group = "tip"', 'group = "tip"\nnode = 3', "found node and group"),
    lap(
        "load in an omitted harmonic",
        'group = "tip"',
        'group = "tip"\nharmonic = 5',
        "harmonic = 5: [solver] harmonics = 3 leaves it out",
    ),
    lap(
        "dof with a mesh",
        'group = "tip"\ndirection = [0.0, 0.0, 1.0]',
        "dof = 3",
        "[[loads]] 1 dof: belongs to a model given as matrices",
    ),
    lap(
        "missing material",
        'material = "steel"\n[bodies.right]',
        'material = "stel"\n[bodies.right]',
        '[bodies.left] material = "stel"',
        'nearest is "steel"',
    ),
    lap(
        "group of two bodies",
        'group = "beam_2"',
        'group = "beam_1"',
        '[bodies.right] group = "beam_1": [bodies.left] has it already',
    ),
    lap("preload by no statics", "preload = 1e6", 'preload = "static"', 'preload = "static": there is no table [statics]'),
    lap("axis without rotation", 'mesh = "lap.msh"', AXIS, "[model] axis: nothing turns"),
    lap(
        "error bars needed and refused",
        "modes = 5",
        "accuracy = 0.01\nerror_bars = false",
        "error_bars = false: accuracy chooses",
    ),
    lap(
        "accuracy_of without accuracy",
        "modes = 5",
        'modes = 5\naccuracy_of = "corrected"',
        "accuracy_of has no effect without accuracy",
    ),
    lap("iwan without its keys", "friction = 0.3", 'law = "iwan"', '[[joints]] 1 ("lap")', "slip_force is missing"),
    lap("key of another law", "friction = 0.3", "friction = 0.3\nchi = -0.5", '[[joints]] 1 ("lap")', "chi"),
    lap(
        "absolute motion without a base",
        'name = "tip"',
        'name = "tip"\nabsolute = true',
        "absolute: no load has a base_acceleration",
    ),
    lap(
        "stress without a component",
        "direction = [0.0, 0.0, 1.0]\n[damping]",
        'quantity = "stress"\n[damping]',
        "component is missing",
    ),
    with_more("statics that load nothing", "[statics]\n", "[statics] loads nothing", "rotation_speed"),
    with_more("statics without an axis", STATICS, "[statics] rotation_speed: [model] axis is missing"),
    with_more(
        "bolt of two loads",
        '[statics]\n[[statics.bolts]]\ngroup = "clamp"\nforce = 1.0\nshortening = 1e-6\n',
        "[[statics.bolts]] 1: exactly one of force, shortening",
    ),
    with_more(
        "temperature without expansion",
        '[statics]\n[[statics.temperatures]]\ngroup = "beam_1"\ntemperature = 10.0\n',
        "[materials.steel] expansion is missing",
    ),
    with_more(
        "output of one name",
        '[[outputs]]\nname = "tip"\nnode = 3\ndirection = [1.0, 0.0, 0.0]\n',
        '[[outputs]] name = "tip" is used 2 times',
    ),
    with_more(
        "missing point",
        '[[loads]]\npoint = "q"\ndirection = [1.0, 0.0, 0.0]\n',
        '[[loads]] 2 point = "q": there is no such point',
    ),
    with_more("tie of one surface", '[[ties]]\nsurfaces = ["tip", "tip"]\n', "[[ties]] 1 surfaces", "two different groups"),
    with_more(
        "travelling pressure with an engine order",
        '[[loads]]\ngroup = "tip"\npressure = 1.0\ntravelling = [1.0, 0.0, 0.0]\nengine_order = 2\n',
        "exactly one of travelling, engine_order",
    ),
    with_more(
        "surface of no body",
        '[[surfaces]]\nname = "s"\nbodies = ["left", "rigth"]\n',
        '[[surfaces]] 1 ("s") bodies holds "rigth": there is no such body; nearest is "right"',
    ),
    with_more(
        "wear of no such joint",
        "[wear]\ncoefficient = { lop = 1e-14 }\ncycles = 1e6\n",
        "[wear] coefficient: there is no joint 'lop'; nearest is \"lap\"",
    ),
    with_more(
        "wear without a coefficient", "[wear]\ncoefficient = {}\ncycles = 1e6\n", "[wear] coefficient: joint 'lap' has none"
    ),
    with_more("wear of a negative number", "[wear]\ncoefficient = -1e-14\ncycles = 1e6\n", "[wear] coefficient = -1e-14"),
    with_more("wear of negative cycles", "[wear]\ncoefficient = 1e-14\ncycles = -1.0\n", "[wear] cycles = -1.0"),
    with_more("wear by an unknown law", '[wear]\nlaw = "archad"\ncoefficient = 1e-14\ncycles = 1e6\n', 'nearest is "archard"'),
    with_more(
        "wear at no such output",
        '[wear]\ncoefficient = 1e-14\ncycles = 1e6\noutput = "tpi"\n',
        "[wear] output: there is no output 'tpi'; nearest is \"tip\"",
    ),
    with_more(
        "wear at two places", '[wear]\ncoefficient = 1e-14\ncycles = 1e6\noutput = "tip"\nfrequency = 20.0\n', "[wear]: output"
    ),
    with_more(
        "wear of a stated preload with statics",
        STATICS + '[[statics.forces]]\ngroup = "tip"\nforce = [0.0, 0.0, -1.0]\n[wear]\ncoefficient = 1e-14\ncycles = 1e6\n',
        "joint 'lap' states preload",
    ),
    with_more("surface of one body", '[[surfaces]]\nname = "s"\nbodies = ["left", "left"]\n', "normal is missing"),
]

CASES = [*FILES, *MISSING, *UNKNOWN, *VALUES, *CONTRADICTIONS]
