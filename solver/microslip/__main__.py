"""The program: start MPI and PETSc, read the command, execute it, and end with a status that states the outcome."""

from __future__ import annotations

import gc
import os
import sys

if __name__ == "__main__" or os.path.basename(sys.argv[0]) == "microslip":
    # the folder of a scene is no place for modules: python -m puts it before all others
    sys.path[:] = [folder for folder in sys.path if folder not in ("", os.getcwd())]
    from microslip.system.start import open_streams, stop_at_once

    open_streams()
    stop_at_once()

from contextlib import nullcontext, suppress
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from .guards.ending import conclude, leave, no_exit, require
from .guards.lock import locked
from .guards.overdue import leave_signals_to_main, oversee_signals, pass_on_to_first, repeat_early_signal
from .messages.errors import CaseError, ResourceError, naming
from .parallel.agree import on_root
from .parallel.petsc import initialise, unused_options
from .program.command_line import Command, parse
from .system.signals import obey_signals, unsignalled
from .system.start import launcher_rank, too_little_address_space
from .system.walltime import time_limit
from .system.watchdog import show_stacks, watch, wrong_limit

if TYPE_CHECKING:
    from mpi4py import MPI

    from .scene.schema import Scene

# before anything imports NumPy or Matplotlib
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # ranks, not threads, share the processors
os.environ.setdefault("OMPI_MCA_ess_singleton_isolated", "1")  # one rank alone needs no daemon of Open MPI, which takes 0.1 s
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # else it reads what every installed package offers
os.environ["MPLBACKEND"] = "Agg"  # pictures are files, also where there is a screen


def console() -> NoReturn:
    """Run the program with the arguments of the process and end it."""
    gc.set_threshold(50_000, 20, 50)  # the default collects 400 times in a small run, for 0.1 s, and frees next to nothing
    watch()
    oversee_signals()
    leave(main(sys.argv[1:]))


def main(arguments: list[str]) -> int:
    """Run the program and return its exit status.  Collective on all ranks."""
    lack_of_memory = too_little_address_space()
    comm = None if lack_of_memory else _world()

    def action() -> int:
        obey_signals(launcher_rank() == 0)
        command = parse(arguments)
        if lack_of_memory:
            raise ResourceError(lack_of_memory)
        with no_exit():
            return _perform(command, comm)

    return conclude(comm, action)


def _world() -> MPI.Comm | None:
    """Return the communicator of all ranks, or None where mpi4py is missing."""
    try:
        with unsignalled():
            from mpi4py import MPI
    except ImportError:
        return None
    finally:
        leave_signals_to_main()
    return MPI.COMM_WORLD


def _perform(command: Command, comm: MPI.Comm | None) -> int:
    """Execute the command and return the exit status.  Collective on ``comm``."""
    if command.name == "doctor":
        return _doctor()
    if command.name in ("plot", "report", "convert"):
        return _show(command, comm)
    if command.name == "diff":
        return _diff(command, comm)
    if command.name == "new" or (command.name == "check" and _is_model(command.file)):
        return _look(command, comm)
    with naming(command.file):
        return _solve(command, comm)


def _doctor() -> int:
    from .program.doctor import examine

    lines, is_well = examine()
    if launcher_rank() == 0:
        print("\n".join(lines))
    return 0 if is_well else 2


def _show(command: Command, comm: MPI.Comm | None) -> int:
    """Draw, report or convert a result file, on rank 0.  Collective on ``comm``."""
    from .program.doctor import faults

    require(comm, faults("matplotlib", "h5py"))
    out = Path(command.file).parent if command.out is None else command.out
    files = on_root(comm, _shown, command, out) if comm is not None else _shown(command, out)
    if launcher_rank() == 0:
        print("\n".join(map(str, files)) if files else f"{command.file} holds no converged point; nothing is drawn")
        print(unfinished(command.file), end="")
    return 0


def unfinished(file: str) -> str:
    """Return a line on the levels that a result file lacks; "" where it has all of them.  Local."""
    from .results.read import read_results

    results = read_results(file, motion=False)
    missing = ", ".join(f"{level:g}" for level in results.missing)
    return missing and f"{file} is of a run that has not come to its end: {missing} {results.level_unit} missing or at work\n"


def _shown(command: Command, out: Path) -> list:
    """Write the requested files of a result file and return their names.  Local."""
    from .results.read import read_in_sandbox

    read_in_sandbox(command.file)
    if command.name == "report":
        from .results.report.page import write_report

        return [write_report(command.file, out)]
    if command.name == "convert":
        from .results.convert import STEPS, convert

        return convert(command.file, out, command.options.get("to", ()), command.options.get("steps", STEPS))
    from .results.plots import draw_all

    return draw_all(command.file, str(out))


def _diff(command: Command, comm: MPI.Comm | None) -> int:
    """Compare two result files on rank 0, and return 1 if they differ.  Collective on ``comm``."""
    from .program.doctor import faults

    require(comm, faults("matplotlib", "h5py", "pydantic"))
    from .results.read import read_in_sandbox
    from .studies.diff.report import compare_files

    def compared(*arguments) -> tuple[str, int]:
        for file in arguments[:2]:
            read_in_sandbox(file)
        return compare_files(*arguments)

    of = command.options
    arguments = command.file, of["other"], of.get("tolerance"), "bars" in of, command.out, "as_json" in of
    text, status = on_root(comm, compared, *arguments) if comm is not None else compared(*arguments)
    if launcher_rank() == 0:
        print(text)
    return status


def _is_model(file: str) -> bool:
    """Return whether a file's name ends as those of model files do, and not as a scene."""
    from .formats.read import READERS

    return Path(file).suffix.lower() in READERS


def _look(command: Command, comm: MPI.Comm | None) -> int:
    """Check a model file, or write a first scene for it.  Collective on ``comm``."""
    from .program.doctor import faults

    require(comm, faults("pydantic", "mpi4py", "matplotlib"))
    assert comm is not None, "mpi4py is there"
    if command.settings:
        raise CaseError(f"--set {command.settings[0]}: {command.file} is a model file; keys belong to a scene")
    if command.name == "check":
        from .studies.check.model_file import check_model

        check_model(command.file, comm, command.out)
    else:
        from .studies.new.command import new

        new(command.file, comm, command.out, "force" in command.options)
    return 0


def _solve(command: Command, comm: MPI.Comm | None) -> int:
    """Run, compare, verify, trade, export or check a scene, or find its modes.  Collective on ``comm``."""
    from .program.doctor import faults

    require(comm, wrong_limit() or faults("pydantic", "mpi4py"))
    assert comm is not None, "mpi4py is there"
    from .parallel.rank_groups import refuse_too_many
    from .scene.read import read_scene
    from .scene.schema import Scene, SceneOfModes

    refuse_too_many(command.options.get("groups", 1), comm.size)
    kind = SceneOfModes if command.name == "modes" else Scene
    files = (command.file, *command.options.get("more", ()))
    scene, *more = (on_root(comm, read_scene, file, command.settings, kind) for file in files)
    with suppress(ImportError):  # what is missing is named with the rest, below
        initialise(list(command.petsc))
    require(comm, faults())
    obey_signals(comm.rank == 0)
    pass_on_to_first(comm)
    repeat_early_signal()
    show_stacks()
    if command.name == "check":
        from .studies.check.command import check

        check(scene, comm, command.out)
        return 0
    if command.name == "run":
        out, status = _run([scene, *more], command, comm)
    else:
        out, status = Path("results", f"{scene.name}_{command.name}") if command.out is None else command.out, 0
        number, parts = command.options.get("part", (1, 1))
        with locked(comm, out if parts == 1 else out / f"part-{number}"):
            _study(command, scene, comm, out)
    unused = set.intersection(*map(set, comm.allgather(unused_options(command.petsc))))  # a group may have had no work
    if unused and status == 0:
        raise CaseError(
            f"{min(unused)}: no solver of this run reads this PETSc option; the results in {out} were made without it"
        )
    return status


def _run(scenes: list[Scene], command: Command, comm: MPI.Comm) -> tuple[Path, int]:
    """Run one scene or several; return where the results are, and the exit status.  Collective on ``comm``."""
    from . import run
    from .studies.batch import run_scenes

    of = command.options
    limit = on_root(comm, time_limit, of.get("walltime"))
    options = run.RunOptions(command.petsc, of.get("groups"), "divide" in of, fresh="fresh" in of, limit=limit)
    if len(scenes) > 1:
        out = Path("results") if command.out is None else command.out
        return out, run_scenes(scenes, comm, out, options)
    out = Path("results", scenes[0].name) if command.out is None else command.out
    run.run(scenes[0], comm, out, options)
    return out, 0


def _study(command: Command, scene: Scene, comm: MPI.Comm, out: Path) -> None:
    """Perform a study of a scene, into a folder.  Collective on ``comm``."""
    from .observe.stops import explaining_new_start

    module = import_module(f".studies.{command.name}.command", __package__)
    names = {field.name for field in fields(module.Request)}
    request = module.Request(**{name: value for name, value in command.options.items() if name in names})
    continues = command.name in ("backbone", "sweep", "wear")  # which name their checkpoints themselves
    with nullcontext() if continues else explaining_new_start(command.name):
        module.study(scene, comm, out, request, command.petsc)


if __name__ == "__main__":
    console()
