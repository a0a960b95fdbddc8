"""Faults of the disk and of solvers that need no patch: full disks, folders at output paths, bad options of solvers."""

from __future__ import annotations

from .case import Case, Spoil, edited

FULL = "/dev/full"  # a device without space


def full(file: str) -> Spoil:
    """Return a function that links a file to a full device."""

    def spoil(folder):
        (folder / file).parent.mkdir(exist_ok=True)
        (folder / file).symlink_to(FULL)

    return spoil


def blocked(file: str) -> Spoil:
    """Return a function that makes a folder, with contents, at the path of an output file."""
    return lambda folder: (folder / file / "something").mkdir(parents=True)


def disk(name: str, spoil: Spoil, *words: str, status: int = 4, line: str = "run chain.toml --out new") -> Case:
    return Case(name, line, words, spoil, status)


def solver(name: str, options: str, *words: str, status: int = 3, scene: str = "chain", spoil: Spoil | None = None) -> Case:
    return Case(name, f"run {scene}.toml --out new {options}", words, spoil, status)


WORDS = ("No space left on device", "make room")
DISK = [
    disk("disk full: frf.csv", full("new/frf.csv"), "frf.csv", *WORDS),
    disk("disk full: report", full("new/report.html.part"), "report.html", *WORDS, line="report out/results.h5 --out new"),
    disk("disk full: picture", full("new/response.png.part"), "response.png", *WORDS, line="plot out/results.h5 --out new"),
    disk("disk full: mat", full("new/results.mat.part"), "results.mat", *WORDS, line="convert out/results.h5 --to mat --out new"),
    disk("disk full: export", full("new/model.npz.part"), "model.npz", *WORDS, line="export chain.toml --out new"),
    disk("disk full: modes", full("new/modes.csv.part"), "modes.csv", *WORDS, line="modes chain.toml --out new"),
    disk(
        "disk full: comparison",
        full("new/compare.csv.part"),
        "compare.csv",
        *WORDS,
        line="compare chain.toml --methods receptance --out new",
    ),
    disk("disk full: unv", full("new/results.unv.part"), "results.unv", *WORDS, line="convert out/results.h5 --to unv --out new"),
    disk("disk full: scene", full("bar.toml.part"), "bar.toml", *WORDS, line="new bar.inp --out bar.toml"),
    disk("path blocked: frf.csv", blocked("new/frf.csv"), "frf.csv: cannot be written: Is a directory", status=2),
    disk("path blocked: results.h5", blocked("new/results.h5"), "results.h5: cannot be written: Is a directory", status=2),
    disk("path blocked: results.h5.part", blocked("new/results.h5.part"), "results.h5: cannot be written", status=2),
    disk("path blocked: run.log", blocked("new/run.log"), "run.log: cannot be written: Is a directory", status=2),
    disk(
        "path blocked: a picture",
        blocked("pictures/response.png"),
        "pictures/response.png: cannot be written: Is a directory",
        status=2,
        line="plot out/results.h5 --out pictures",
    ),
    disk(
        "path blocked: report",
        blocked("new/report.html"),
        "report.html: cannot be written: Is a directory",
        status=2,
        line="report out/results.h5 --out new",
    ),
    disk("folder is a link to nothing", lambda folder: (folder / "new").symlink_to("none"), "new: cannot be written", status=2),
]

PULL = '[statics]\n[[statics.forces]]\ngroup = "tip"\nforce = [0.0, 0.0, -1e5]\n[damping]'
SOLVERS = [
    solver(
        "word for a number",
        "-- -hb_snes_max_it few",
        "PETSc refuses an option",
        "few has no integer value",
        "-hb_snes_max_it few",
        status=2,
    ),
    solver("unknown kind of a solver", "-- -hb_snes_type newtonn", "PETSc refuses an option", "newtonn", status=2),
    solver(
        "negative tolerance",
        "-- -hb_ksp_rtol -1",
        "PETSc refuses an option",
        "Relative tolerance -1",
        "-hb_ksp_rtol -1",
        status=2,
    ),
    solver("unknown preconditioner", "-- -static_pc_type luu", "PETSc refuses an option", "luu", status=2),
    solver("unknown factor", "-- -static_pc_factor_mat_solver_type mumpss", "mumpss", "-static_", status=2),
    solver("an unused option", "-- -hb_snes_maxit 5", "-hb_snes_maxit: no solver of this run reads this PETSc option", status=2),
    solver(
        "statics that push the body away",
        "",
        "[statics]: no equilibrium beyond",
        "body 'right' turns about",
        scene="lap",
        spoil=edited("lap.toml", "preload = 1e6", 'preload = "static"', "[damping]", PULL),
    ),
]

CASES = [*DISK, *SOLVERS]
