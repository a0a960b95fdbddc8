"""The story of a trade: one structure, many settings at the same frequencies, each against a reference that is known to be good."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from .compare import LARGEST_REFERENCE
from .modes.limits import most_modes
from .parallel.agree import on_root
from .parallel.errors import CaseError, MicroslipError
from .parallel.log import RunLog
from .parallel.versions import versions
from .parallel.words import nearest
from .reduction.methods import METHODS
from .results.trade import ACCURACY, BASE, COMBINED, KNOBS, TARGETS, Run, Setting, Study, promising
from .results.trade_report import write_trade
from .run import build_structure
from .trade_bench import Bench, Clock
from .trade_reference import TOLERANCE, find_reference, frequencies

SECONDS = 100.0                     # to be spent in all, unless the command line says otherwise
UNTIL_REFERENCE, UNTIL_KNOBS = 0.4, 0.8     # shares of that
VALUES: dict[str, tuple] = {
    "harmonics": (1, 2, 3, 5, 7, 9, 13, 19, 27),
    "samples": (32, 64, 128, 256, 512, 1024, 2048),
    "modes": (1, 2, 3, 5, 8, 12, 20),
    "tolerance": (1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10),
}
EPS = (-1, -2, -3, -4, -6)          # decades below the largest loss of a pair
BASE_HARMONICS, BASE_SAMPLES, BASE_TOLERANCE = 5, 256, 1e-8
FEWEST_OF_REFERENCE = 60            # modes
COMBINATIONS = 10
COMBINED_KNOBS = ("harmonics", "samples", "modes", "tolerance")


@dataclass(frozen=True)
class Asked:
    """What the command line asks of a trade."""

    knobs: tuple[str, ...] = KNOBS
    levels: tuple[float, ...] = ()          # N; empty: the first of the scene with slip, and its strongest
    meshes: tuple[str, ...] = ()            # files beside the scene's own mesh
    seconds: float = SECONDS


def trade(scene, comm, folder: Path, asked: Asked | None = None, options: tuple[str, ...] = ()) -> Study:
    """Measure what each knob of a scene costs and buys; print and write a table, a picture and choices.

    Collective on ``comm``.  A run that fails says so in its row.

    Raises
    ------
    CaseError : an unknown knob, or a scene with nothing to trade; on every rank
    ConvergenceError : no reference; on every rank
    """
    asked = asked or Asked()
    check_asked(scene, asked)
    facts = {"scene": str(scene.path), "PETSc options": " ".join(options) or "none", **versions()}
    with RunLog(comm, str(folder / "trade.log"), facts=facts) as log:
        study = measured(scene, comm, asked, log)
        log.note(on_root(comm, write_trade, study, scene, str(folder)))
        log.note(f"results in {folder}")
    return study


def check_asked(scene, asked: Asked) -> None:
    """Refuse what cannot be traded.  Local.

    Raises
    ------
    CaseError
    """
    for name in asked.knobs:
        if name not in KNOBS:
            near = nearest(name, KNOBS)
            raise CaseError(f"--knobs: unknown knob {name!r}{f'; nearest is {near}' if near else ''}; known: {', '.join(KNOBS)}")
    for level in asked.levels:
        if not 0.0 < level < float("inf"):
            raise CaseError(f"--levels: {level:g} N is not a force above 0")
    if not 0.0 < asked.seconds < float("inf"):
        raise CaseError(f"--seconds: {asked.seconds:g} is not a time above 0")
    if not scene.joints:
        raise CaseError(f"{scene.path}: [[joints]] is missing: without a joint the response is linear, and nothing is to trade")
    if scene.solver.harmonics == 0:
        raise CaseError(f"{scene.path}: [solver] harmonics = 0 is a static balance; trade needs a vibration")
    if asked.meshes and scene.model.mesh is None:
        raise CaseError(f"--meshes: {scene.path} is given as matrices; there is no other mesh of it")
    for mesh in asked.meshes:
        if not Path(mesh).is_file():
            raise CaseError(f"--meshes: there is no file {mesh}")


def measured(scene, comm, asked: Asked, log: RunLog) -> Study:
    """Return the study of a scene.  Collective."""
    clock = Clock(comm, asked.seconds)
    structure = build_structure(scene_by(scene, "receptance"), comm, log)
    shared = {stage.name: stage.seconds for stage in log.stages if stage.depth == 0 and stage.name != "modes"}
    bench = Bench(scene, structure)
    try:
        base = base_of(bench)
        with log.stage("modes of the reference"):
            measure_modes(bench, base.modes)
        with log.stage("frequencies"):
            omegas, most = frequencies(bench, base, asked.levels or None)
        with log.stage("reference"):
            start = replace(base, samples=512, tolerance=TOLERANCE)
            reference = find_reference(bench, omegas, start, clock, UNTIL_REFERENCE, log.note)
        study = Study(scene.title or scene.name, scene.name, reference, base, shared=shared)
        with log.stage("runs, knob by knob"):
            log_run(log, study, bench.run(BASE, "", base, omegas))
            until = {ACCURACY: 1.0} | dict.fromkeys(KNOBS, UNTIL_KNOBS)
            for knob, value, setting in settings(bench, base, study, asked.knobs, most):
                run_in_time(bench, study, (knob, value, setting), omegas, clock, until[knob], log)
        with log.stage("runs, combined"):
            knobs = [knob for knob in COMBINED_KNOBS if knob in asked.knobs]
            for setting in comm.bcast(promising(study, knobs, COMBINATIONS)):
                run_in_time(bench, study, (COMBINED, "", setting), omegas, clock, 1.0, log)
        shared["static columns"] = comm.bcast(bench.columns_seconds)
    finally:
        structure.linearised.destroy()
    if asked.meshes and "mesh" in asked.knobs:
        with log.stage("meshes"):
            study.meshes = mesh_runs(scene, comm, asked, base, log)
    study.notes.append(f"{clock.spent:.0f} s in all, {reference.seconds:.0f} s of them for the reference")
    return study


def scene_by(scene, method: str):
    """Return the scene with another method.  Local."""
    return scene.model_copy(update={"solver": scene.solver.model_copy(update={"method": method})})


def base_of(bench: Bench) -> Setting:
    """Return the setting about which knobs are turned one by one.  Local."""
    H = max(BASE_HARMONICS, bench.least_harmonics)
    return Setting(len(bench.structure.modes.omega_n), H, max(BASE_SAMPLES, 16 * H), BASE_TOLERANCE)


def measure_modes(bench: Bench, n_base: int) -> None:
    """Compute the modes of the reference, and learn what fewer cost.  Collective."""
    n_dof = bench.structure.linearised.system.n_dof
    most = min(max(FEWEST_OF_REFERENCE, 3 * n_base), most_modes(n_dof))
    for n_modes in sorted({bench.scene.response.mode or 1, n_base, most}):
        bench.more_modes(n_modes)


def settings(bench: Bench, base: Setting, study: Study, knobs: Sequence[str], most: float) -> list[tuple[str, str, Setting]]:
    """Return the runs: knob, name of its value, setting.  Local; the same on all ranks.

    ``most``, the largest loss of a pair [J a cycle], is what energies are judged against.
    """
    found = []
    for knob in ("harmonics", "samples", "modes", "tolerance"):
        for value in values(bench, base, study, knob) if knob in knobs else ():
            setting = replace(base, **{knob: value})
            if value != getattr(base, knob) and setting.samples > 2 * setting.harmonics:
                found.append((knob, f"{value:g}", setting))
    found += [(ACCURACY, f"{target:g}", replace(base, accuracy=target)) for target in TARGETS]
    if "method" in knobs:
        n_dof = bench.structure.linearised.system.n_dof
        names = [name for name in METHODS if name != base.method and (name != "full" or n_dof <= LARGEST_REFERENCE)]
        found += [("method", name, replace(base, method=name)) for name in names if name != "adaptive-energy" or "eps" not in knobs]
    if "eps" in knobs and most > 0.0:
        energies = [float(f"{10.0**decade * most:.0e}") for decade in EPS]
        found += [("eps", f"{eps:g} J", replace(base, method="adaptive-energy", energy_tolerance=eps)) for eps in energies]
    return found


def values(bench: Bench, base: Setting, study: Study, knob: str) -> list:
    """Return the values of a knob that make sense here.  Local."""
    if knob == "harmonics":
        return [H for H in VALUES[knob] if bench.least_harmonics <= H < max(study.reference.setting.harmonics, base.harmonics)]
    if knob == "modes":
        least, most = bench.scene.response.mode or 1, study.reference.setting.modes
        return sorted({m for m in VALUES[knob] if least <= m <= most} | {most})
    return list(VALUES[knob])


def run_in_time(bench: Bench, study: Study, what: tuple[str, str, Setting], omegas, clock: Clock, share: float, log: RunLog) -> None:
    """Add a run to the study, unless the time is up.  Collective."""
    knob, value, setting = what
    if setting.accuracy is not None:
        setting = with_modes_for(bench, setting)
    if clock.left(share) <= 0.0:
        nothing = float("nan")
        run = Run(knob, value, setting, nothing, nothing, nothing, nothing, 0, (), "left out: the time was up; raise --seconds")
    else:
        run = bench.run(knob, value, setting, omegas)
    log_run(log, study, run)


def with_modes_for(bench: Bench, setting: Setting) -> Setting:
    """Return an accuracy's setting with the number of modes that the program picks for it.  Collective."""
    from .reduction.choose_modes import choose_modes

    if bench.scene.solver.modes is not None:
        return setting
    try:
        scene = bench.scene_of(setting)
        scene = scene.model_copy(update={"solver": scene.solver.model_copy(update={"modes": None, "verify_modes": False})})
        modes, _ = choose_modes(bench.structure.linearised, bench.structure.pairs, scene)
    except MicroslipError:
        return replace(setting, modes=len(bench.modes.omega_n))
    return replace(setting, modes=min(len(modes.omega_n), len(bench.modes.omega_n)))


def log_run(log: RunLog, study: Study, run: Run) -> None:
    """Add a run to the study and say in a line what it did.  Local."""
    study.runs.append(run)
    score, name = study.score(run), f"  {run.knob} {run.value}"
    log.note(f"{name:<34} {run.seconds:8.3f} s  error {score.error:8.1e}  bar {score.bar:8.1e}  {run.failure or ''}".rstrip())


def mesh_runs(scene, comm, asked: Asked, base: Setting, log: RunLog) -> list[Run]:
    """Return a run of the base a mesh, coarse to fine, all at the frequencies that any of them needs.  Collective."""
    found: list[tuple[int, Run]] = []
    benches = []
    omegas: dict[float, list[float]] = {}
    for mesh in dict.fromkeys([str(scene.folder / scene.model.mesh), *(str(Path(mesh).absolute()) for mesh in asked.meshes)]):
        clock = Clock(comm, 1.0)
        try:
            solver = scene.solver.model_copy(update={"method": "receptance", "modes": base.modes})
            other = scene.model_copy(update={"model": scene.model.model_copy(update={"mesh": mesh}), "solver": solver})
            structure = build_structure(other, comm, log)
            setup = clock.spent
            bench = Bench(other, structure)
            own, _ = frequencies(bench, base, asked.levels or None)
            benches.append((mesh, bench, setup))
        except MicroslipError as problem:
            found.append((0, Run("mesh", Path(mesh).name, replace(base, mesh=mesh), *[float("nan")] * 4, 0, (), str(problem))))
            continue
        for level, points in own.items():
            omegas[level] = sorted({*omegas.get(level, ()), *points}, reverse=bench.sweep.direction < 0)
    for mesh, bench, setup in benches:
        run = bench.run("mesh", Path(mesh).name, replace(base, mesh=mesh), omegas, bars=False)
        found.append((bench.structure.linearised.system.n_dof, replace(run, setup=setup)))
        bench.structure.linearised.destroy()
    return [run for _, run in sorted(found, key=lambda entry: entry[0])]
