"""The command `trade`: one structure, many settings at the same frequencies, compared with a reference of known error."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from math import gcd
from pathlib import Path

from mpi4py import MPI

from ...formats.read import read_model
from ...library.build import build
from ...library.complete import complete, held_by
from ...library.settings import by_method, reduction_settings, refuse_statics
from ...mesh.read import read_mesh
from ...messages.errors import CaseError, MicroslipError
from ...messages.words import hint
from ...modes.limits import most_modes
from ...observe.log import RunLog
from ...parallel.agree import on_root
from ...reduction.choose_modes import choose_modes
from ...reduction.methods import METHODS
from ...scene.checks.disc import OF_DISCS
from ...scene.read import changed
from ...scene.schema import Scene
from ..compare.command import LARGEST_REFERENCE
from ..log import log_of
from .bench import Bench, Clock, not_run
from .reference import Ladder, find_reference, frequencies
from .report import write_trade
from .study import ACCURACY, BASE, COMBINED, PARAMETERS, TARGETS, Run, Setting, Study, promising

SECONDS = 105.0  # default time budget
UNTIL_REFERENCE, UNTIL_COMBINED = 0.33, 0.8  # fractions of the time budget
VALUES: dict[str, tuple] = {
    "harmonics": (1, 2, 3, 5, 7, 9, 13, 19, 27, 41),
    "samples": (32, 64, 128, 256, 512, 1024),
    "modes": (1, 2, 3, 5, 8, 12, 20),
    "tolerance": (1e-2, 1e-3, 1e-4, 1e-6, 1e-8),
}
EPS = (-1, -2, -3, -5)  # decades below the largest loss of a pair
BASE_HARMONICS, BASE_SAMPLES, BASE_TOLERANCE = 5, 256, 1e-8
FEWEST_OF_REFERENCE = 40  # least modes of the reference
COMBINATIONS = 8
MANY = 20  # harmonics from which runs are long and come late
GROWTH = 3.0  # exponent of the time over the number of harmonics in the worst case
COMBINED_PARAMETERS = ("harmonics", "samples", "modes", "tolerance")
OF_LINEAR = ("modes", "method", "mesh")  # settings with effect on a response without slip


@dataclass(frozen=True)
class Request:
    """Options of the command line."""

    parameters: tuple[str, ...] = PARAMETERS
    levels: tuple[float, ...] = ()  # N; empty: the scene's first level with slip, and its highest
    meshes: tuple[str, ...] = ()  # further mesh files
    seconds: float = SECONDS


def study(scene: Scene, comm: MPI.Comm, folder: Path, request: Request, options: tuple[str, ...] = ()) -> Study:
    """Measure time and error of each setting of a scene; print and write a table, a picture and choices.

    Collective on ``comm``.  The row of a failed run has the reason.

    Raises
    ------
    CaseError : an unknown setting, or a scene without effect of settings; on every rank, partly after the first curves
    ConvergenceError : no reference; on every rank
    """
    check_request(scene, request)
    with log_of(comm, folder / "trade.log", scene, options) as log:
        on_root(comm, check_meshes, scene, request)
        study = measured(scene, comm, request, log)
        log.note(on_root(comm, write_trade, study, scene, str(folder)))
        log.note(f"results in {folder}")
    return study


def check_request(scene: Scene, request: Request) -> None:
    """Refuse unsuitable scenes and options.  Local.  Raises CaseError."""
    for name in request.parameters:
        if name not in PARAMETERS:
            raise CaseError(f"--vary: unknown parameter {name!r}{hint(name, PARAMETERS, str)}; known: {', '.join(PARAMETERS)}")
    for level in request.levels:
        if not 0.0 < level < float("inf"):
            raise CaseError(f"--levels: {level:g} N is not a force above 0")
    if not 0.0 < request.seconds < float("inf"):
        raise CaseError(f"--seconds: {request.seconds:g} is not a time above 0")
    if not scene.joints:
        raise CaseError(f"{scene.path}: [[joints]] is missing: without a joint the response is linear, and nothing is to trade")
    refuse_statics(scene, "trade")
    if scene.leaves_harmonics_out:
        raise CaseError(
            f"{scene.path}: [solver] harmonics = {list(scene.chosen_harmonics)}: trade varies the highest of all; state "
            f"harmonics = {scene.harmonics}"
        )
    if scene.cyclic is not None and scene.cyclic.whole:
        raise CaseError(
            f"{scene.path}: [cyclic] whole = true: trade measures a disc by one sector, whose errors those of all sectors are; "
            "leave whole out, with what makes sectors differ"
        )
    check_loads(scene)
    if request.meshes and "mesh" not in request.parameters:
        raise CaseError(
            f"--meshes: of --vary {','.join(request.parameters)} no mesh varies; add mesh to --vary, or leave --meshes out"
        )
    if "mesh" in request.parameters and not request.meshes and request.parameters != PARAMETERS:
        raise CaseError("--vary mesh: there is no other mesh; state --meshes A.msh,B.msh, or leave mesh out of --vary")
    if request.meshes and scene.model.mesh is None:
        raise CaseError(f"--meshes: {scene.path} is given as matrices; there is no other mesh of it")
    for mesh in request.meshes:
        if not Path(mesh).is_file():
            fault = "that is a folder" if Path(mesh).is_dir() else "there is no such file"
            raise CaseError(f"--meshes {mesh}: {fault}; expected mesh files of the same scene, with the same groups")


def check_meshes(scene: Scene, request: Request) -> None:
    """Refuse meshes that the scene cannot have, before any of them costs time.  Local, on rank 0.  Raises CaseError."""
    for mesh in request.meshes if "mesh" in request.parameters else ():
        try:
            of_mesh = changed(scene, {"model": {"mesh": str(Path(mesh).absolute())}})
            model = read_model(Path(mesh).absolute(), scene.model.step)
            completed, _ = complete(of_mesh, model)
            read_mesh(completed, held_by(of_mesh, model))
        except MicroslipError as problem:
            raise CaseError(f"--meshes: {problem}\n  expected mesh files of the same scene, with the same groups") from None


def check_loads(scene: Scene) -> None:
    """Refuse loads without motion in harmonic 1, in which errors are measured.  Local.  Raises CaseError."""
    numbers = sorted({load.harmonic for load in scene.loads} - {0})
    if not numbers:
        raise CaseError(
            f"{scene.path}: [[loads]] harmonic = 0: all loads are constant; trade needs a vibration: add a load with harmonic = 1"
        )
    common = gcd(*numbers)
    if common > 1:
        stated, lower = (", ".join(map(str, harmonics)) for harmonics in (numbers, [n // common for n in numbers]))
        raise CaseError(
            f"{scene.path}: [[loads]] harmonic = {stated}: nothing moves in harmonic 1, of which trade measures "
            f"errors; state harmonic = {lower}, and {common} times the frequencies in [response]: the same motion"
        )


def measured(scene: Scene, comm: MPI.Comm, request: Request, log: RunLog) -> Study:
    """Return the study of a scene.  Collective."""
    clock = Clock(comm, request.seconds)
    structure = build(by_method(scene, "receptance"), comm, log)
    shared = {stage.name: stage.seconds for stage in log.stages if stage.depth == 0 and stage.name != "modes"}
    bench = Bench(scene, structure)
    try:
        base = base_of(bench)
        with log.stage("modes of the reference"):
            measure_modes(bench, base.modes)
        with log.stage("frequencies"):
            omegas, most, slips = frequencies(bench, cheap(bench, base), request.levels or None)
        parameters, base = (request.parameters, base) if slips else linear_trade(bench, request.parameters, base, list(omegas))
        with log.stage("reference"):
            ladder = Ladder(bench, omegas, clock)
            reference = find_reference(ladder, base, UNTIL_REFERENCE, log.note, slips)
        study = Study(scene.title or scene.name, scene.name, reference, base, shared=shared, is_linear=not slips)
        first, later = settings(bench, base, study, parameters, most)
        with log.stage("runs, parameter by parameter"):
            for what in [(BASE, "", base), *first]:
                run_in_time(ladder, study, what, UNTIL_COMBINED, log)
        with log.stage("runs, combined"):
            combined = [parameter for parameter in COMBINED_PARAMETERS if parameter in parameters]
            for setting in comm.bcast(promising(study, combined, COMBINATIONS)):
                run_in_time(ladder, study, (COMBINED, "", setting), UNTIL_COMBINED, log)
        with log.stage("runs, methods and what takes long"):
            for what in later:
                run_in_time(ladder, study, what, 1.0, log)
        shared["static columns"] = comm.bcast(structure.statics.G_static.seconds)
    finally:
        structure.close()
    if request.meshes and "mesh" in request.parameters:
        with log.stage("meshes"):
            study.meshes.extend(mesh_runs(scene, comm, request, base, log))
    study.notes.append(f"{clock.spent:.0f} s in all, {reference.seconds:.0f} s of them for the reference")
    return study


def base_of(bench: Bench) -> Setting:
    """Return the base setting, of which single values are varied.  Local."""
    H = max(BASE_HARMONICS, bench.least_harmonics)
    return Setting(len(bench.structure.modes.omega_n), H, max(BASE_SAMPLES, 16 * H), BASE_TOLERANCE)


def linear_trade(bench: Bench, parameters: Sequence[str], base: Setting, levels: list[float]) -> tuple[tuple[str, ...], Setting]:
    """Return the settings that change a response without slip, and its base with only the harmonics of the loads.  Local.

    Raises
    ------
    CaseError : the command line requests none of them
    """
    effective = tuple(parameter for parameter in parameters if parameter in OF_LINEAR)
    if not effective:
        raise CaseError(
            f"--vary {','.join(parameters)}: no pair slips or opens at {', '.join(f'{level:g}' for level in levels)} N, "
            f"and of a linear response none of these changes anything; turn some of {', '.join(OF_LINEAR)}, or raise "
            "--levels or [response] levels until something slips"
        )
    H = bench.least_harmonics
    return effective, replace(base, harmonics=H, samples=max(BASE_SAMPLES, 16 * H))


def cheap(bench: Bench, base: Setting) -> Setting:
    """Return the setting of the coarse curves that determine the points.  Local."""
    H = max(3, bench.least_harmonics)
    return replace(base, harmonics=H, samples=max(128, 16 * H), tolerance=1e-6)


def measure_modes(bench: Bench, n_base: int) -> None:
    """Compute the modes of the reference, and measure the time of fewer modes.  Collective."""
    n_dof = bench.structure.n_dof
    most = min(max(FEWEST_OF_REFERENCE, 3 * n_base), most_modes(n_dof))
    for n_modes in sorted({bench.least_modes, most}):
        bench.more_modes(n_modes)


def settings(
    bench: Bench, base: Setting, study: Study, parameters: Sequence[str], most: float
) -> tuple[list[tuple[str, str, Setting]], list[tuple[str, str, Setting]]]:
    """Return the runs as (parameter, value, setting): first the runs used in combinations, then the others.  Local.

    The same on all ranks.  ``most``: the largest loss of a pair [J per cycle], the scale of energies.
    """
    first: list[tuple[str, str, Setting]] = []
    later: list[tuple[str, str, Setting]] = []
    last: list[tuple[str, str, Setting]] = []
    varied = {
        parameter: [value for value in values(bench, base, study, parameter) if value != getattr(base, parameter)]
        for parameter in COMBINED_PARAMETERS
        if parameter in parameters
    }
    for H in varied.pop("harmonics", []):
        setting = replace(base, harmonics=H, samples=max(base.samples, 4 * (H + 1)))
        (first if H < MANY else last).append(("harmonics", f"{H}", setting))
    for row in zip_longest(*([(parameter, value) for value in ends_first(options)] for parameter, options in varied.items())):
        settings_of_row = [(parameter, f"{value:g}", base.varied(parameter, value)) for parameter, value in filter(None, row)]
        first += [entry for entry in settings_of_row if entry[2].samples > 2 * entry[2].harmonics]
    later += [(ACCURACY, f"{target:g}", replace(base, accuracy=target)) for target in TARGETS[:2]]
    of_corrected = replace(base, accuracy_of="corrected")
    later += [(ACCURACY, f"{target:g} corrected", replace(of_corrected, accuracy=target)) for target in TARGETS[:2]]
    if "eps" in parameters and most > 0.0:
        energies = [float(f"{10.0**decade * most:.0e}") for decade in EPS]
        later += [("eps", f"{eps:g} J", replace(base, method="adaptive-energy", energy_tolerance=eps)) for eps in energies]
    if "method" in parameters:
        n_dof = bench.structure.n_dof
        known = {
            base.method,
            *(["adaptive-energy"] if "eps" in parameters else []),
            *(["full"] if n_dof > LARGEST_REFERENCE else []),
        }
        methods = METHODS if bench.scene.cyclic is None else OF_DISCS
        later += [("method", name, replace(base, method=name)) for name in methods if name not in known]
    return first, [*later, *last[:1], (ACCURACY, f"{TARGETS[2]:g}", replace(base, accuracy=TARGETS[2])), *last[1:]]


def ends_first(entries: list) -> list:
    """Return a list with its first and last entries in front, the most informative ones if time runs out.  Local."""
    return [*entries[:1], *entries[1:][-1:], *entries[1:-1]]


def values(bench: Bench, base: Setting, study: Study, parameter: str) -> list:
    """Return the suitable values of a setting.  Local."""
    if parameter == "harmonics":
        return [
            H for H in VALUES[parameter] if bench.least_harmonics <= H < max(study.reference.setting.harmonics, base.harmonics)
        ]
    if parameter == "modes":
        least, most = bench.least_modes, study.reference.setting.modes
        return [m for m in VALUES[parameter] if least <= m <= most]
    return list(VALUES[parameter])


def run_in_time(ladder: Ladder, study: Study, what: tuple[str, str, Setting], share: float, log: RunLog) -> None:
    """Add a run at the points of the reference to the study, unless the fraction ``share`` of the time is spent.  Collective."""
    (parameter, value, setting), bench = what, ladder.bench
    if parameter != BASE and ladder.clock.left(share) <= expected(study, parameter, setting):
        run = not_run(parameter, value, setting, "left out for lack of time, raise --seconds")
    else:
        run = bench.run(parameter, value, setting if setting.accuracy is None else with_modes_for(bench, setting), ladder.omegas)
    log_run(log, study, run)


def expected(study: Study, parameter: str, setting: Setting) -> float:
    """Return the expected time of a run with many harmonics or the least error [s]; 0 if unknown.  Local."""
    known = [run for run in study.complete if run.parameter == ("harmonics" if parameter == "harmonics" else ACCURACY)]
    if not known or (parameter == "harmonics" and setting.harmonics < MANY) or parameter not in ("harmonics", ACCURACY):
        return 0.0
    growth = (setting.harmonics / known[-1].setting.harmonics) ** GROWTH if parameter == "harmonics" else 4.0
    return growth * known[-1].seconds_with_bars


def with_modes_for(bench: Bench, setting: Setting) -> Setting:
    """Return the setting of an accuracy with the number of modes chosen by the program.  Collective."""
    if bench.scene.solver.modes is not None:
        return setting
    try:
        settings = replace(reduction_settings(bench.scene_of(setting)), modes=None, verify_modes=False)
        structure, _ = choose_modes(bench.structure, settings)
    except MicroslipError:
        return replace(setting, modes=len(bench.modes.omega_n))
    return replace(setting, modes=min(structure.n_modes, len(bench.modes.omega_n)))


def log_run(log: RunLog, study: Study, run: Run) -> None:
    """Add a run to the study and log a line with its results.  Local."""
    study.runs.append(run)
    score, name = study.score(run), f"  {run.parameter} {run.value}"
    log.note(f"{name:<34} {run.seconds:8.3f} s  error {score.error:8.1e}  bar {score.bar:8.1e}  {run.failure or ''}".rstrip())


def mesh_runs(scene: Scene, comm: MPI.Comm, request: Request, base: Setting, log: RunLog) -> list[Run]:
    """Return one run of the base per mesh, coarse to fine, all at the union of their frequencies.  Collective."""
    assert scene.model.mesh is not None, "other meshes belong to a scene with one"
    runs: list[tuple[int, Run]] = []
    benches = []
    omegas: dict[float, list[float]] = {}
    for mesh in dict.fromkeys([str(scene.folder / scene.model.mesh), *(str(Path(mesh).absolute()) for mesh in request.meshes)]):
        clock = Clock(comm, 1.0)
        try:
            of_mesh = changed(scene, {"model": {"mesh": mesh}, "solver": {"method": "receptance", "modes": base.modes}})
            structure = build(of_mesh, comm, log)
            setup = clock.spent
            bench = Bench(of_mesh, structure)
            of_mesh_omegas, _, _ = frequencies(bench, cheap(bench, base), request.levels or None)
            benches.append((mesh, bench, setup))
        except MicroslipError as problem:
            runs.append((0, not_run("mesh", Path(mesh).name, replace(base, mesh=mesh), str(problem))))
            continue
        for level, points in of_mesh_omegas.items():
            omegas[level] = sorted({*omegas.get(level, ()), *points}, reverse=bench.sweep.direction < 0)
    for mesh, bench, setup in benches:
        run = bench.run("mesh", Path(mesh).name, replace(base, mesh=mesh), omegas, bars=False)
        runs.append((bench.structure.n_dof, replace(run, setup=setup)))
        bench.structure.close()
    return [run for _, run in sorted(runs, key=lambda entry: entry[0])]
