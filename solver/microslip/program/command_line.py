"""The command line: commands and their options, and the PETSc options that follow ``--``."""

import argparse
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

from ..messages.errors import CaseError
from ..messages.words import hint, listed
from ..parallel.petsc import PREFIXES
from ..system.walltime import seconds_of
from ..version import __version__

# commands that PETSc options are for
_SOLVE = tuple("run modes backbone search sweep wear compare verify trade export identify".split())
_SCENE = (*_SOLVE, "check")  # commands that read a scene
_DESCRIPTION = "Steady-state vibration of jointed structures with friction contact."
_EPILOG = f"""\
In parallel: mpirun -n N microslip run SCENE.toml; several levels or scenes at once: mpirun -n N microslip run --groups G ...
PETSc options follow --, each with the prefix of its solver: {", ".join("-" + prefix for prefix in PREFIXES)}
Exit status: 0 done; 1 diff found a difference; 2 error in the scene, the mesh or an option; 3 the computation did not
finish, converged points are saved; 4 memory or disk; 5 stopped by a signal or before the time limit: run, backbone,
sweep and wear have saved all points, and the same command continues from there; 70 a defect of the program.
SIGUSR1 saves and continues; SIGTERM, SIGINT and SIGHUP save and stop; SIGUSR2 prints the stack of each rank."""


@dataclass(frozen=True)
class Command:
    """A command and its options."""

    name: str  # one of the commands: run, modes, backbone, ..., doctor
    file: str = ""  # the scene, the model file, or the results to show
    out: Path | None = None  # None: the default of the command
    petsc: tuple[str, ...] = ()  # checked options after ``--``
    settings: tuple[str, ...] = ()  # KEY=VALUE, overrides keys of the scene
    options: Mapping[str, Any] = field(default_factory=dict)  # stated options of the command, by ``_OPTIONS``; switches are True


class _Parser(argparse.ArgumentParser):
    """argparse that raises CaseError instead of ending the process."""

    def error(self, message: str) -> NoReturn:
        raise CaseError(f"{message}; try: {self.prog} --help")


def parse(arguments: list[str]) -> Command:
    """Return the command of a command line without the program's name.  Local.

    Raises
    ------
    CaseError : an unknown command or option, with the nearest known word
    SystemExit : after --help and --version
    """
    cut = arguments.index("--") if "--" in arguments else len(arguments)
    words, petsc = arguments[:cut], arguments[cut + 1 :]
    parser, commands = _parsers()
    word = next((argument for argument in words if not argument.startswith("-")), None)
    if word is None and not {"-h", "--help", "--version"} & set(words):
        raise CaseError(f"a command is missing: {listed(commands, 'or')}; try: microslip --help")
    if word is not None and word not in commands:
        raise CaseError(f"unknown command {word!r}{hint(word, commands, str)}; commands are {listed(commands)}")
    for argument in words:
        if argument.startswith(tuple(f"-{prefix}" for prefix in PREFIXES)):
            raise CaseError(f"{argument}: PETSc options follow --, as in: microslip run SCENE.toml -- {argument}")
    given, unknown = parser.parse_known_args(words)
    if given.command == "run" and not any(argument.startswith("-") for argument in unknown):
        given.more, unknown = [*given.more, *unknown], []  # scenes before and after an option
    if unknown:
        raise CaseError(_unknown(unknown[0], commands.get(given.command, parser)))
    if petsc and given.command not in _SOLVE:
        raise CaseError(f"PETSc options after -- belong to the commands {listed(_SOLVE)}; {given.command} solves nothing")
    values: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in vars(given).items()}
    settings = values.pop("settings", ())
    if given.command == "sweep":
        values["swept"] = tuple(text for text in settings if is_swept(text))
        settings = tuple(text for text in settings if not is_swept(text))
    name, file, out = values.pop("command"), values.pop("file", ""), values.pop("out", None)
    stated = {option: value for option, value in values.items() if value is not None and value is not False and value != ()}
    return Command(name, file, out, petsc_options(petsc), settings, stated)


def _parsers() -> tuple[_Parser, dict[str, _Parser]]:
    """Return the parser of the program and those of its commands."""
    parser = _Parser(
        "microslip",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        allow_abbrev=False,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"microslip {__version__}")
    group = parser.add_subparsers(dest="command", metavar="COMMAND", parser_class=_Parser)
    commands: dict[str, _Parser] = {}
    for name, (summary, file, out) in _COMMANDS.items():
        after = " [-- PETSc options]" if name in _SOLVE else ""
        command = group.add_parser(name, help=summary, description=summary.capitalize() + ".", allow_abbrev=False)
        if file is not None:
            command.add_argument("file", metavar=file, type=_results if file.endswith(".h5") else str)
        if out is not None:
            command.add_argument("--out", metavar="DIR", type=Path, help=f"output folder (default: {out})")
        for of, flag, how in _OPTIONS:
            if name in of:
                command.add_argument(flag, **how)
        command.usage = command.format_usage().removeprefix("usage: ").strip() + after
        commands[name] = command
    return parser, commands


def is_swept(text: str) -> bool:
    """Return whether KEY=VALUE has a list or a range in place of a value of a scene, or is a level, no key of a scene.  Local."""
    key, _, value = (part.strip() for part in text.partition("="))
    return (
        key == "level"
        or not value.startswith(("[", "{", '"', "'"))
        and ("," in value or (":" in value and not value[:1].isalpha()))
    )


def _results(text: str) -> str:
    """Return the result file of a run's folder, or the file that the text names."""
    inside = Path(text, "results.h5")
    return str(inside) if inside.is_file() else text


def _part(text: str) -> tuple[int, int]:
    """Return which part of how many, I/N."""
    words = text.split("/")
    if len(words) != 2 or not all(word.isdecimal() for word in words) or not 1 <= int(words[0]) <= int(words[1]):
        raise argparse.ArgumentTypeError(f"{text!r} is not I/N with I from 1 to N, as 3/8")
    return int(words[0]), int(words[1])


def _seed(text: str) -> int:
    """Return a whole number of at least 0."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least 0")
    return int(text)


def _numbers(text: str) -> tuple[float, ...]:
    """Return numbers above 0, separated by commas."""
    try:
        numbers = tuple(float(word) for word in text.split(","))
    except ValueError:
        numbers = ()
    if not numbers or not all(0.0 < number < float("inf") for number in numbers):
        raise argparse.ArgumentTypeError(f"{text!r} are not numbers above 0, separated by commas")
    if len(set(numbers)) < len(numbers):
        raise argparse.ArgumentTypeError(f"{text!r} holds a number twice")
    return numbers


def _speeds(text: str) -> tuple[float, ...]:
    """Return at least two numbers above 0."""
    numbers = _numbers(text)
    if len(numbers) < 2:
        raise argparse.ArgumentTypeError(f"{text!r} is one speed; for one, use --set statics.rotation_speed={text}")
    return numbers


def _orders(text: str) -> tuple[int, ...]:
    """Return whole numbers of at least 1, ascending."""
    return _ascending(text, [_count(word.strip()) for word in text.split(",")])


def _diameters(text: str) -> tuple[int, ...]:
    """Return whole numbers of at least 0, ascending."""
    words = [word.strip() for word in text.split(",")]
    if not all(word.isdecimal() for word in words):
        raise argparse.ArgumentTypeError(f"{text!r} are not whole numbers of at least 0, separated by commas")
    return _ascending(text, [int(word) for word in words])


def _ascending(text: str, numbers: list[int]) -> tuple[int, ...]:
    """Return numbers in ascending order, none of them twice."""
    if len(set(numbers)) < len(numbers):
        raise argparse.ArgumentTypeError(f"{text!r} holds a number twice")
    return tuple(sorted(numbers))


def _steps(text: str) -> int:
    """Return an even number of at least 16."""
    if not text.isdecimal() or int(text) < 16 or int(text) % 2:
        raise argparse.ArgumentTypeError(f"{text!r} is not an even number of at least 16")
    return int(text)


def _count(text: str) -> int:
    """Return a number of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of at least 1")
    return int(text)


def _words(text: str) -> tuple[str, ...]:
    """Return the words between commas, at least one."""
    words = tuple(word.strip() for word in text.split(",") if word.strip())
    if not words:
        raise argparse.ArgumentTypeError(f"{text!r} has no words; expected at least one, several separated by commas")
    return words


def _above_zero(text: str) -> float:
    """Return a number above 0."""
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if not 0.0 < number < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return number


def _above_one(text: str) -> float:
    """Return a number above 1."""
    with suppress(ValueError):
        if 1.0 < (number := float(text)) < float("inf"):
            return number
    raise argparse.ArgumentTypeError(f"{text!r} is not a number above 1")


def _time(text: str) -> float:
    """Return a time in seconds."""
    seconds = seconds_of(text)
    if not seconds:
        raise argparse.ArgumentTypeError(f"{text!r} is not a time above 0, as 3600, 90m, 1h30m, 01:30:00 or 1-12:00:00")
    return seconds


def _unknown(argument: str, command: _Parser) -> str:
    """Return the message for an argument that a command does not take."""
    name = argument.split("=")[0]
    if name.startswith("-"):
        known = [option for action in command._actions for option in action.option_strings]
        return f"unknown option {name}{hint(name, known, str)}; {command.prog} has {listed(known)}"
    return f"{argument!r} is one argument too many; usage: {command.usage}"


def petsc_options(arguments: list[str]) -> tuple[str, ...]:
    """Return the options for PETSc unchanged, if each has a prefix of this program.  Local.

    Raises
    ------
    CaseError : a name without such a prefix, or a value without a name
    """
    prefixes = listed([f"-{prefix}" for prefix in PREFIXES], "or")
    for i, argument in enumerate(arguments):
        if _is_name(argument):
            name = argument.lstrip("-")
            if argument != f"-{name}" or not name.startswith(PREFIXES) or name in PREFIXES:
                hint = _with_prefix(name)
                raise CaseError(f"{argument}: not an option of this program's solvers; they begin with {prefixes}{hint}")
        elif i == 0 or not _is_name(arguments[i - 1]):
            raise CaseError(f"{argument!r} after --: an option's name is missing before it; names begin with {prefixes}")
    return tuple(arguments)


def _is_name(argument: str) -> bool:
    """Return whether an argument is an option's name, and not a value such as -1e-3."""
    return len(argument) > 1 and argument[0] == "-" and (argument[1].isalpha() or argument[1] in "-_")


def _with_prefix(name: str) -> str:
    """Return a hint for an option without one of the prefixes."""
    first, _, rest = name.partition("_")
    if name == "out":
        return "; put --out before --"
    places = {"eps": "modes_", "st": "modes_", "snes": "hb_", "ksp": "hb_", "mat": "static_", "pc": "static_"}
    if first in places:
        return f"; perhaps -{places[first]}{name}"
    return hint(first + "_", PREFIXES, lambda near: f"-{near}{rest}") if rest else ""


_FOLDER = "the folder of the result file"
_COMMANDS: dict[str, tuple[str, str | None, str | None]] = {  # summary, input file, default of --out
    "run": ("one scene or several, from mesh to response and pictures", "SCENE.toml", "results/NAME OF THE SCENE"),
    "modes": ("natural frequencies and shapes with all joints stuck: table and pictures", "SCENE.toml", "results/NAME_modes"),
    "backbone": ("frequency and damping of a mode against its amplitude, without loads", "SCENE.toml", "results/NAME_backbone"),
    "search": ("other solutions at a frequency, with their stability", "SCENE.toml", "results/NAME_search"),
    "sweep": ("peaks for other numbers of a scene: lists, grids, scatter", "SCENE.toml", "results/NAME_sweep"),
    "wear": ("the joint over its life: depth, preload, drift of the peak by jumps of cycles", "SCENE.toml", "results/NAME_wear"),
    "compare": ("one scene by several methods at the same points, in one table", "SCENE.toml", "results/NAME_compare"),
    "verify": ("time integration at points of the curves, compared with harmonic balance", "SCENE.toml", "results/NAME_verify"),
    "trade": ("speed and accuracy of a scene: effect of each setting on time and error", "SCENE.toml", "results/NAME_trade"),
    "export": ("the reduced model as .npz and .mat, with scripts for other programs", "SCENE.toml", "results/NAME_export"),
    "identify": ("parameters of a scene that explain a measurement, with intervals", "SCENE.toml", "results/NAME_identify"),
    "check": ("validate a scene, or list the content of a model file; nothing is solved", "SCENE.toml", None),
    "new": ("a first scene for a model file, with candidates for joints", "MODEL", None),
    "plot": ("draw all pictures again from the result file", "RESULTS.h5", _FOLDER),
    "report": ("all results of a run in one HTML file", "RESULTS.h5", _FOLDER),
    "convert": ("results for other programs: ParaView, universal files, MATLAB", "RESULTS.h5", _FOLDER),
    "diff": ("compare two results: inputs, structure and every curve, with a verdict", "A.h5", "no diff.png and diff.json"),
    "doctor": ("print versions, and missing packages with the commands to install them", None, None),
}


def _option(of: str | tuple[str, ...], flag: str, metavar: str | None, meaning: str, **how) -> tuple[tuple[str, ...], str, dict]:
    """Return commands, flag and argparse's words of an option; one that takes no value is a switch."""
    kind = {"metavar": metavar} if metavar is not None else {"action": "store_true"}
    return (of,) if isinstance(of, str) else of, flag, {**kind, "help": meaning, **how}


_LIST, _NUMBERS = {"type": _words}, {"type": _numbers}
_OPTIONS = (
    _option(
        _SCENE,
        "--set",
        "KEY=VALUE",
        "override a key of the scene, for example joints.dovetail.friction=0.2; may be given several times; of a sweep also "
        "KEY=A,B,..., KEY=FIRST:LAST:COUNT or KEY=FIRST:LAST:COUNT:log, several keys as a grid",
        dest="settings",
        action="append",
        default=[],
    ),
    _option("run", "more", "MORE.toml", "further scenes; with --out DIR each in DIR/NAME", nargs="*", default=[]),
    _option(
        "sweep",
        "--scatter",
        "KEY=PERCENT",
        "samples about the number of the scene with this standard deviation in per cent, lognormal; KEY=PERCENT:normal or "
        "KEY=PERCENT:uniform (half of the range); may be given several times",
        action="append",
        default=[],
    ),
    _option("sweep", "--table", "FILE.csv", "samples: a first line of keys, a line of numbers for each"),
    _option("sweep", "--samples", "N", "how many, of --scatter (default: 64)", type=_count),
    _option(
        "sweep",
        "--design",
        "NAME",
        "of --scatter: sobol, latin, or indices, N (keys + 2) samples for Sobol indices (default: sobol)",
    ),
    _option("sweep", "--seed", "N", "of the samples (default: 0)", type=_seed),
    _option("sweep", "--one-by-one", None, "each key of --set alone, others as in the scene, in place of a grid"),
    _option("sweep", "--output", "NAME", "whose peak (default: the first output)"),
    _option(
        "sweep", "--outside", "refuse|skip", "samples that the scene does not allow (default: refuse)", choices=("refuse", "skip")
    ),
    _option("sweep", "--curves", None, "the curve of each sample, too: percentile bands"),
    _option(
        "sweep",
        "--keep-modes",
        None,
        "leave the modes as they are under another contact stiffness, in place of a structure for each",
    ),
    _option("sweep", "--part", "I/N", "of a job array: every N-th sample from the I-th on", type=_part),
    _option(
        "sweep", "--groups", "G", "split the ranks into G groups, each with samples of its own (default: each rank)", type=_count
    ),
    _option("sweep", "--fresh", None, "compute all samples again, in place of those that an earlier run has stored"),
    _option(
        "run",
        "--groups",
        "G",
        "split the ranks into G groups that solve levels in parallel (default: the fastest number); "
        "with several scenes each group solves scenes (default: 1)",
        type=_count,
    ),
    _option(
        "run",
        "--divide",
        None,
        "divide each level into parts that the groups follow at the same time (default with it: a group for each rank), for few "
        "long levels on many ranks",
    ),
    _option(
        ("run", "backbone", "wear"),
        "--fresh",
        None,
        "recompute everything instead of continuing an earlier run; earlier results of run move to earlier-N/",
    ),
    _option(
        ("run", "backbone", "sweep"),
        "--walltime",
        "T",
        "time limit: the run saves and stops before it, with status 5; 3600, 90m, 1h30m, HH:MM:SS, D-HH:MM:SS "
        "(default: the remaining time of the Slurm or PBS job)",
        type=_time,
    ),
    _option("modes", "--count", "N", "number of modes (default: [solver] modes, or 12)", type=_count),
    _option(
        "modes",
        "--speeds",
        "A,B,...",
        "speeds of rotation in rad/s, at least two, for a Campbell diagram with [statics] at each speed",
        type=_speeds,
    ),
    _option(
        "modes",
        "--diameters",
        "A,B,...",
        "nodal diameters of a disc (default: all, from 0 to half of the sectors)",
        type=_diameters,
    ),
    _option(
        "modes", "--orders", "A,B,...", "engine orders (default: 1 to 6; for a disc 1 to the number of sectors)", type=_orders
    ),
    _option("backbone", "--mode", "N", "number of the mode, with all joints stuck (default: 1)", type=_count),
    _option(
        "backbone",
        "--farthest",
        "X",
        "last amplitude over the amplitude at first slip (default: gross slip, where the damping is past its maximum)",
        type=_above_one,
    ),
    _option(
        "backbone",
        "--levels",
        "A,B,...",
        "levels in N of forced responses, synthesised from the mode and computed (default: none)",
        **_NUMBERS,
    ),
    _option("search", "--at", "F", "frequency in Hz", dest="frequency", type=_above_zero, required=True),
    _option("search", "--level", "A", "level in N (default: the highest of the scene)", type=_above_zero),
    _option("search", "--starts", "N", "motions from which Newton's method by deflation begins (default: 30)", type=_count),
    _option("search", "--continue", None, "follow the curve from each solution that the curve of the level lacks", dest="follow"),
    _option("compare", "--methods", "A,B,...", "names of methods, separated by commas (default: all)", **_LIST),
    _option(
        "trade",
        "--vary",
        "A,B,...",
        "settings to vary: harmonics, samples, modes, tolerance, eps, method, mesh, separated by commas (default: all)",
        dest="parameters",
        **_LIST,
    ),
    _option(
        "trade",
        "--levels",
        "A,B,...",
        "levels in N, separated by commas (default: the first level of the scene with slip, and the highest)",
        **_NUMBERS,
    ),
    _option(
        "trade",
        "--meshes",
        "A,B,...",
        "further meshes of the same scene, with the same groups, to measure the effect of the mesh",
        **_LIST,
    ),
    _option(
        "trade", "--seconds", "S", "approximate time budget; more time gives a better reference (default: 105)", type=_above_zero
    ),
    _option(
        "verify",
        "--at",
        "F1,F2,...",
        "frequencies in Hz (default: the peak of each level and two points on each side)",
        **_NUMBERS,
    ),
    _option("verify", "--levels", "A,B,...", "levels in N (default: the scene's)", **_NUMBERS),
    _option("verify", "--harmonics", "H", "harmonics of harmonic balance (default: the scene's)", type=_count),
    _option("verify", "--samples", "N", "time samples of harmonic balance (default: the scene's)", type=_count),
    _option("verify", "--steps", "N", "time steps per period (default: 256)", type=_steps),
    _option("verify", "--from-rest", None, "integrate from rest, without acceleration: many periods"),
    _option(
        "verify", "--disturbed", None, "disturb each steady state, and compare what becomes of it with the Floquet multipliers"
    ),
    _option("export", "--method", "NAME", "reduction method (default: the scene's, if it has finite matrices)"),
    _option("export", "--recovery", None, "also write the map from the coordinates to full fields"),
    _option("identify", "other", "MEASURED.csv", "rows of frequency, amplitude and phase, or of peaks"),
    _option(
        "identify",
        "--fit",
        "KEY=LOW:HIGH",
        "a parameter of the scene and its bounds, as joints.dovetail.friction=0.1:0.6; may be given several times",
        action="append",
        default=[],
    ),
    _option("convert", "--to", "A,B,...", "vtkhdf, unv, mat, separated by commas (default: all), or scene", **_LIST),
    _option("convert", "--steps", "N", "time steps per period in files for ParaView (default: 32)", type=_steps),
    _option("check", "--out", "DIR", "draw the mesh with its sets: DIR/mesh.png (default: no picture)", type=Path),
    _option(
        "new", "--out", "SCENE.toml", "scene to write (default: name of the model with .toml, in the current folder)", type=Path
    ),
    _option("new", "--force", None, "overwrite an existing file"),
    _option("diff", "other", "B.h5", "", type=_results),
    _option(
        "diff",
        "--tolerance",
        "T",
        "accepted difference of curves relative to the peak (default: 1e-6, plus the resolution of their points)",
        type=_above_zero,
    ),
    _option("diff", "--bars", None, "ignore differences inside the error bars"),
    _option("diff", "--json", None, "print the comparison as JSON", dest="as_json"),
)
