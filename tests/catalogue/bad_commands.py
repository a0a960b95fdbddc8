"""Bad command lines, and output paths that cannot be written."""

from __future__ import annotations

from .case import Case, forbidden, written


def line(name: str, text: str, *words: str, spoil=None, **more) -> Case:
    return Case(name, text, words, spoil, **more)


COMMANDS = [
    line("no command", "", "a command is missing: run, modes, backbone, search, sweep, wear"),
    line("unknown command", "rnu lap.toml", "unknown command 'rnu'; nearest is run"),
    line("no scene", "run", "SCENE.toml", "try: microslip run --help"),
    line("scene for a command", "lap.toml", "unknown command 'lap.toml'"),
    line("unknown option", "run lap.toml --oout out", "unknown option --oout; nearest is --out"),
    line("option without a value", "run lap.toml --out", "argument --out: expected one argument"),
    line("option of another command", "run lap.toml --steps 64", "unknown option --steps"),
    line("one argument too many", "check lap.toml chain.toml", "'chain.toml' is one argument too many"),
    line("groups of 0", "run lap.toml --groups 0", "argument --groups: '0' is not a number of at least 1"),
    line("groups of words", "run lap.toml --groups two", "argument --groups: 'two'"),
    line("more groups than ranks", "run lap.toml --out out --groups 9", "--groups 9: there", "mpirun -n 9"),
    line("a time of words", "run lap.toml --out out --walltime soon", "--walltime", "soon"),
    line("no time", "run lap.toml --out out --walltime 0", "--walltime"),
    line("one result to compare", "diff out/results.h5", "required"),
    line("PETSc option before --", "run lap.toml -hb_snes_monitor", "-hb_snes_monitor: PETSc options follow --"),
    line("PETSc option without a prefix", "run lap.toml --out out -- -snes_monitor", "perhaps -hb_snes_monitor"),
    line("PETSc option of a misspelled prefix", "run lap.toml --out out -- -statc_ksp_rtol 1", "nearest is -static_ksp_rtol"),
    line(
        "PETSc option that loads code",
        "run lap.toml --out out -- -dll_append lib.so",
        "-dll_append: not an option of this program's solvers",
    ),
    line(
        "PETSc value without a name", "run lap.toml --out out -- 3 -hb_snes_max_it", "'3' after --: an option's name is missing"
    ),
    line("PETSc options of check", "check lap.toml -- -hb_snes_monitor", "check solves nothing"),
    line("--set without a value", "run lap.toml --out out --set solver.modes", "--set solver.modes: expected KEY=VALUE"),
    line(
        "--set of an unknown table", "run lap.toml --out out --set sovler.modes=3", "[sovler]: unknown table; nearest is [solver]"
    ),
    line(
        "--set of an unknown key", "run lap.toml --out out --set solver.mods=3", '[solver] mods: unknown key; nearest is "modes"'
    ),
    line(
        "--set of no joint",
        "run lap.toml --out out --set joints.lop.friction=0.1",
        '--set joints.lop.friction=0.1: there is no [[joints]] "lop"; nearest is "lap"',
    ),
    line("--set of which joint", "run lap.toml --out out --set joints.friction=0.1", "of which [[joints]]?"),
    line(
        "--set out of range", "run lap.toml --out out --set response.points=1", "[response] points = 1", "--set response.points=1"
    ),
    line("--set of a key as a table", "run lap.toml --out out --set model.mesh.x=1", "mesh is a key, not a table"),
    line("--set in a model file", "check bar.inp --set model.scale=2", "bar.inp is a model file; keys belong to a scene"),
    line(
        "identification of a missing file",
        "identify lap.toml none.csv --out out --fit joints.lap.friction=0.01:10",
        "none.csv",
        "No such file",
    ),
    line("identification without bounds", "identify lap.toml m.csv --out out --fit friction", "expected KEY=LOW:HIGH"),
    line(
        "identification of a number twice",
        "identify lap.toml m.csv --out out --fit joints.lap.friction=0.1:0.6 --fit joints.lap.friction=0.2:0.4",
        "joints.lap.friction is stated twice",
    ),
    line(
        "a measurement without columns",
        "identify lap.toml m.csv --out out --fit joints.lap.friction=0.1:0.6",
        'm.csv: the column "1" is unknown',
        "frequency_Hz",
        spoil=written("m.csv", "1,2\n3,4\n"),
    ),
    line(
        "a universal file without functions",
        "identify lap.toml m.unv --out out --fit joints.lap.friction=0.1:0.6",
        "m.unv: there is no frequency response function",
        "data set 58",
        spoil=written("m.unv", "    -1\n   151\n    -1\n"),
    ),
    line(
        "an invalid MATLAB file",
        "identify lap.toml m.mat --out out --fit joints.lap.friction=0.1:0.6",
        "m.mat: it cannot be read as a MATLAB file",
        spoil=written("m.mat", "frequency_Hz\n"),
    ),
    line("unknown method to compare", "compare lap.toml --out out --methods full,rubbin", "rubbin", "nearest is rubin"),
    line("unknown parameter of trade", "trade lap.toml --out out --vary mods", "mods", "nearest is modes"),
    line("missing mesh to trade", "trade lap.toml --out out --vary mesh --meshes none.msh", "none.msh", "there is no"),
    line("folder as a mesh to trade", "trade lap.toml --out out --meshes .", "--meshes .: that is a folder"),
    line(
        "scene as a mesh to trade",
        "trade lap.toml --out out --meshes lap.toml",
        "--meshes: ",
        "lap.toml",
        "mesh files of the same",
    ),
    line("no other mesh to trade", "trade lap.toml --out out --vary mesh", "--vary mesh: there is no other mesh"),
    line("mesh that does not vary", "trade lap.toml --out out --vary modes --meshes lap.msh", "no mesh varies; add mesh"),
    line("no methods to compare", "compare lap.toml --out out --methods ,", "argument --methods: ',' has no words"),
    line("sweep to infinity", "sweep lap.toml --out out --set level=1:inf:3", "--set level=1:inf:3: expected KEY=A,B"),
    line("sweep of no numbers", "sweep lap.toml --out out --set level=1,nan", "--set level=1,nan: expected KEY=A,B"),
    line("folder as a table of samples", "sweep lap.toml --out out --table .", "--table .: that is a folder and no file"),
    line(
        "another mesh of matrices",
        "trade chain.toml --out out --meshes lap.msh",
        "given as matrices; there is no other mesh of it",
    ),
    line("verify at no frequency", "verify lap.toml --out out --at 99,x", "'99,x' are not numbers above 0"),
    line("verify outside the range", "verify lap.toml --out out --at 5000", "--at", "5000 Hz", "choose one there, or widen"),
    line("odd number of steps", "verify lap.toml --out out --steps 33", "'33' is not an even number of at least 16"),
    line("backbone of no such mode", "backbone lap.toml --out out --mode 9", "there is no mode 9: 5 modes were computed"),
    line("backbone that ends before it begins", "backbone lap.toml --out out --farthest 0.5", "'0.5' is not a number above 1"),
    line("search without a frequency", "search lap.toml --out out", "the following arguments are required: --at"),
    line("search outside the range", "search lap.toml --out out --at 5000", "search: --at = 5000 Hz lies outside"),
    line("search at no level", "search lap.toml --out out --at 99 --level -1", "'-1' is not a number above 0"),
    line("wear without its table", "wear lap.toml --out out", "[wear] is missing: expected a table [wear] with coefficient"),
    line("sweep of nothing", "sweep lap.toml --out out", "exactly one of --set KEY=A,B"),
    line("sweep of an unknown key", "sweep lap.toml --out out --set joints.lap.frction=0.1,0.2", 'nearest is "friction"'),
    line("sweep of no joint", "sweep lap.toml --out out --set joints.lop.friction=0.1,0.2", 'nearest is "lap"'),
    line("sweep over half a range", "sweep lap.toml --out out --set level=1:2", "--set level=1:2: expected KEY=A,B"),
    line(
        "samples that the scene does not allow",
        "sweep lap.toml --out out --set joints.lap.friction=-0.1,0.2",
        "1 of 2 samples are outside what the scene allows",
        "--outside skip",
    ),
    line("scatter of no number", "sweep lap.toml --out out --scatter joints.lap.friction=much", "expected KEY=PERCENT"),
    line("missing table of samples", "sweep lap.toml --out out --table none.csv", "none.csv: there is no such file"),
    line(
        "table of samples without keys",
        "sweep lap.toml --out out --table table.csv",
        "table.csv: the columns have no names",
        spoil=written("table.csv", "0.1,0.2\n0.3,0.4\n"),
    ),
    line("export by an unknown method", "export lap.toml --out out --method rubbin", "rubbin", "rubin"),
    line("new of a scene", "new lap.toml", "lap.toml is a scene; new takes the model file"),
    line("new of no file", "new none.inp", "none.inp: there is no such file"),
    line("new of another kind", "new lap.stl", "lap.stl", "'.stl'", spoil=written("lap.stl", "x")),
    line("new where a scene is", "new bar.inp --out lap.toml", "lap.toml", "is not overwritten", "--force"),
    line("check of no model", "check none.msh", "none.msh"),
    line("format to convert to", "convert out/results.h5 --to vtkhd", "vtkhd", "nearest is vtkhdf"),
]

PLACES = [
    line(
        "results into a file",
        "run lap.toml --out lap.msh",
        "lap.msh: cannot be written: that is a file and no folder",
        "choose another folder with --out",
    ),
    line("results below a file", "run lap.toml --out lap.msh/out", "lap.msh/out", "cannot be written"),
    line("results where nobody writes", "run lap.toml --out /proc/out", "/proc/out", "choose another folder with --out"),
    line("results into a name too long", "run lap.toml --out " + 300 * "x", "File name too long"),
    line(
        "results into a forbidden folder",
        "run lap.toml --out blocks",
        "blocks",
        "Permission denied",
        spoil=forbidden("blocks"),
        not_by_root=True,
    ),
    line("pictures into a file", "plot out/results.h5 --out lap.msh", "lap.msh: cannot be written: that is a file and no folder"),
    line("report into a file", "report out/results.h5 --out lap.msh", "lap.msh: cannot be written: that is a file and no folder"),
    line(
        "conversion into a file",
        "convert out/results.h5 --out lap.msh",
        "lap.msh: cannot be written: that is a file and no folder",
    ),
    line("scene into no folder", "new bar.inp --out none/bar.toml", "none/bar.toml", "cannot be written"),
    line("table into a file", "compare lap.toml --out lap.msh", "lap.msh: cannot be written: that is a file and no folder"),
    line(
        "check's picture into a file", "check lap.toml --out lap.msh", "lap.msh: cannot be written: that is a file and no folder"
    ),
]

CASES = [*COMMANDS, *PLACES]
