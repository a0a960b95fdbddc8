"""One reduced model in four programs: microslip, NLvib, TMDSimPy and pyHarm, on the files that `microslip export` writes.

    python meshes/lap_joint.py --out meshes/lap_joint.msh
    python jobs/bench/peers.py [--out DIR] [--cases A,B] [--nlvib SRC] [--tmdsimpy FOLDER] [--python PYTHON] [--picture FILE]

SRC is the folder SRC of NLvib, FOLDER the clone of TMDSimPy, PYTHON an interpreter with pyHarm-os, psutil and jax.  A program
that is not given is left out.  Prints for each case and program: the largest difference of any harmonic of any output from
microslip's, relative to its largest amplitude at that level; the median time of a point; and whether the law is the same.  Draws
the curves.  All programs solve the same reduced model at the same frequencies, one after the other, with the return map at the
samples.
"""

from __future__ import annotations

import microslip  # selects the kernels of OpenBLAS before NumPy is loaded, here and in the other programs

# isort: split
import argparse
import csv
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import machine
import matplotlib
import numpy as np

from microslip.parallel.petsc import everyone, initialise

initialise()

from microslip.continuation.grid import at_frequencies
from microslip.library.build import build
from microslip.library.prepare import prepare
from microslip.scene.read import changed
from microslip.studies.export import command as export

JOBS = Path(__file__).parents[1]
sys.path.insert(0, str(JOBS.parent / "meshes"))

from fan_sector import SIZES, Shape, fan_sector  # noqa: E402
from lap_joint import LapJoint, lap_joint  # noqa: E402
from msh import write_msh  # noqa: E402

PROGRAMS = ("NLvib", "TMDSimPy", "pyHarm")
LOOKS = {"NLvib": ("#d55e00", "s"), "TMDSimPy": ("#009e73", "o"), "pyHarm": ("#0072b2", "^")}


@dataclass(frozen=True)
class Case:
    """A scene, and the programs with the same law."""

    title: str
    scene: microslip.Scene
    same: tuple[str, ...]
    near: tuple[str, ...] = ()  # programs with another law, run on request


@dataclass(frozen=True)
class Curve:
    """The curve of one program: coefficients (n, n_outputs * (2 H + 1)) at levels and frequencies (n,)."""

    level: np.ndarray  # N
    frequency: np.ndarray  # Hz
    seconds: np.ndarray
    values: np.ndarray


def cases(folder: Path, names: list[str]) -> Iterator[tuple[str, Case]]:
    """Yield the cases by name."""
    solver = {"between_samples": "return-map", "method": "joint-interface-modes", "tolerance": 1e-10, "error_bars": False}
    own = {"harmonics": 7, "samples": 256}

    def of(file: str, joint: dict | None = None, harmonics=own, **response):
        scene = microslip.read(JOBS / file)
        joints = {one.name: joint or {} for one in scene.joints}
        return changed(scene, {"solver": {**solver, **harmonics}, "response": response}, joints)

    mass = {"levels": [0.2, 0.3], "frequencies": [0.13, 0.38], "points": 26}
    circle, separate = {"friction_limit": "circle"}, {"friction_limit": "separate"}
    makers = {
        "jenkins": lambda: Case(
            "one mass on a Jenkins element", of("jenkins.toml", levels=[0.02, 0.8, 1.2], points=25), PROGRAMS
        ),
        "plane": lambda: Case(
            "one mass that slides along a line and moves across it", plane(folder, of, mass), ("TMDSimPy", "pyHarm")
        ),
        "circle": lambda: Case(
            "the mass on a friction circle, where sliders drift", of("spatial.toml", circle, **mass), (), ("pyHarm",)
        ),
        "separate": lambda: Case(
            "the mass with a limit for each direction",
            of("spatial.toml", separate, **{**mass, "levels": [0.4, 1.0]}),
            ("TMDSimPy",),
        ),
        "lap": lambda: Case("lap joint of two beams", lap(folder, of, separate), ("TMDSimPy",)),
        "demo": lambda: Case("the demo: fan-blade sector, a friction circle", demo(folder, of, circle), (), ("pyHarm",)),
        "demo-separate": lambda: Case("the demo with a limit for each direction", demo(folder, of, separate), ("TMDSimPy",)),
    }
    for name in names or makers:
        yield name, makers[name]()


def plane(folder: Path, of, response: dict) -> microslip.Scene:
    """Return the mass of jobs/spatial.toml on a contact in x and z only."""
    (folder / "plane.csv").write_text("x1,y1,z1,x2,y2,z2,mu,n0,g0,kt,kn\n0,-1,2,-1,-1,-1,0.4,1.0,0.0,1.5,2.5\n")
    return of("spatial.toml", {"pairs": str(folder / "plane.csv")}, **response)


def lap(folder: Path, of, limits: dict) -> microslip.Scene:
    """Return the scene of the lap joint on a coarse mesh, 9 pairs."""
    write_msh(str(folder / "lap.msh"), lap_joint(LapJoint(n_free=4, n_overlap=1, n_width=1, n_thickness=1)))
    few = {"harmonics": 3, "samples": 128, "accuracy": None, "modes": 6, "interface_modes": 100}
    scene = of("lap_joint.toml", limits, few, levels=[0.5, 2.0], points=15)
    return changed(scene, {"model": {"mesh": str(folder / "lap.msh")}})


def demo(folder: Path, of, limits: dict) -> microslip.Scene:
    """Return the scene of the demo, 46 pairs, at its highest level about the peak."""
    write_msh(str(folder / "fan_small.msh"), fan_sector(Shape(), SIZES["small"]))
    few = {"harmonics": 3, "samples": 128, "accuracy": None, "modes": 8, "interface_modes": 3 * 46}
    scene = of("fan_small.toml", limits, few, levels=[15.0], points=8, mode=None, span=None, frequencies=[97.5, 99.5])
    return changed(scene, {"model": {"mesh": str(folder / "fan_small.msh")}})


def ours(scene: microslip.Scene, frequency: np.ndarray) -> Curve:
    """Return microslip's own response at the frequencies [Hz], on one rank."""
    with build(scene, everyone()) as structure:
        prepared = prepare(structure, has_bars=False)
        response, points = prepared.response, []
        for level in scene.response.levels:
            branch = at_frequencies(
                response.at_level(level), response.selection, list(2 * np.pi * frequency), tolerance=scene.solver.tolerance
            )
            if branch.failure:
                raise SystemExit(f"microslip ends at {level:g} N: {branch.failure}")
            points += [(level, point.omega / (2 * np.pi), point.seconds, point.response.ravel()) for point in branch.points]
    return Curve(*(np.array([one[k] for one in points]) for k in range(4)))


def theirs(command: list[str], file: Path) -> Curve | str:
    """Run a script of an export; return its curve, or its last line of output."""
    done = subprocess.run(command, capture_output=True, text=True, cwd=file.parent)
    if done.returncode:
        return (done.stderr or done.stdout).strip().splitlines()[-1][:120]
    with open(file, newline="") as rows:
        values = np.array([[float(cell) for cell in row] for row in list(csv.reader(rows))[1:]])
    return Curve(values[:, 0], values[:, 1], values[:, 2], values[:, 3:])


def commands(folder: Path, options) -> dict[str, tuple[list[str], Path]]:
    """Return the command of each available program for an export."""
    programs = {}
    if options.nlvib:
        programs["NLvib"] = (
            ["octave-cli", "--no-gui", str(folder / "run_nlvib.m"), options.nlvib],
            folder / "response_nlvib.csv",
        )
    if options.tmdsimpy:
        programs["TMDSimPy"] = (
            [options.python, str(folder / "run_tmdsimpy.py"), options.tmdsimpy],
            folder / "response_tmdsimpy.csv",
        )
    if options.python:
        programs["pyHarm"] = ([options.python, "-W", "ignore", str(folder / "run_pyharm.py")], folder / "response_pyharm.csv")
    return programs


def difference(curve: Curve, reference: Curve) -> dict[float, float]:
    """Return the largest difference of any coefficient over the largest amplitude, at each level."""
    assert np.allclose(curve.frequency, reference.frequency, rtol=1e-12) and np.array_equal(curve.level, reference.level)
    own = {level: reference.level == level for level in np.unique(reference.level)}
    return {
        float(level): float(np.abs(curve.values - reference.values)[at].max() / np.abs(reference.values[at]).max())
        for level, at in own.items()
    }


def main() -> None:
    options = _options()
    folder = Path(options.out or tempfile.mkdtemp()).absolute()
    folder.mkdir(parents=True, exist_ok=True)
    shown = []
    print("\n".join(machine.lines(machine.facts())), flush=True)
    for name, case in cases(folder, options.cases):
        export.study(case.scene, everyone(), folder / name, export.Request())
        model = np.load(folder / name / "model.npz")
        reference, n = ours(case.scene, model["frequency"]), len(model["M"])
        unknowns = n * (2 * case.scene.harmonics + 1)
        print(f"\n{name}: {case.title}; {n} coordinates, {unknowns} unknowns, {case.scene.solver.samples} samples")
        print(
            f"{'program':10} {'law':6} {'largest difference / peak, at each level':48} {'ms a point, median':>20} {'all, s':>8}"
        )
        _line("microslip", "", "reference", reference)
        curves = {}
        for program, (command, file) in commands(folder / name, options).items():
            if program not in (*case.same, *case.near) and not options.others:
                print(f"{program:10} other")
                continue
            curve, law = theirs(command, file), "same" if program in case.same else "other"
            if isinstance(curve, str):
                print(f"{program:10} {law:6} {curve}")
                continue
            curves[program] = curve
            parts = [f"{worst:.1e} at {level:g} N" for level, worst in difference(curve, reference).items()]
            _line(program, law, ", ".join(parts), curve)
        shown.append((case, reference, curves))
    if options.picture:
        draw(shown, options.picture)


def _line(program: str, law: str, text: str, curve: Curve) -> None:
    print(f"{program:10} {law:6} {text:48} {1e3 * np.median(curve.seconds):20.3g} {curve.seconds.sum():8.3g}", flush=True)


def draw(shown: list[tuple[Case, Curve, dict[str, Curve]]], path: str) -> None:
    """Draw the curves of every case, and below them the differences from microslip's."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, len(shown), figsize=(3.6 * len(shown), 5.2), squeeze=False, sharex="col")
    for (case, reference, others), (curve, error) in zip(shown, axes.T):
        amplitude = {name: np.hypot(*one.values[:, 1:3].T) for name, one in {"microslip": reference, **others}.items()}
        for level in np.unique(reference.level):
            at = reference.level == level
            curve.plot(reference.frequency[at], amplitude["microslip"][at] / level, color="#1a1a1a", lw=1.2)
            top = np.argmax(amplitude["microslip"][at])
            curve.annotate(f"{level:g} N", (reference.frequency[at][top], amplitude["microslip"][at][top] / level), fontsize=7)
            scale = np.abs(reference.values[at]).max()
            for program, one in others.items():
                colour, marker = LOOKS[program]
                is_same = program in case.same
                curve.plot(one.frequency[at], amplitude[program][at] / level, marker, ms=4.5, mfc="none", mec=colour, mew=0.9)
                worst = np.maximum(np.abs(one.values - reference.values)[at].max(axis=1) / scale, 1e-16)
                error.plot(one.frequency[at], worst, color=colour, lw=1.0, ls="-" if is_same else ":")
        curve.set_title(case.title, fontsize=8)
        curve.tick_params(labelsize=7)
        error.tick_params(labelsize=7)
        error.set(yscale="log", ylim=(1e-16, 1.0), xlabel="frequency [Hz]")
        error.axhline(1e-6, color="#8a8a8a", lw=0.6)
    axes[0, 0].set_ylabel("amplitude / level [m/N]")
    axes[1, 0].set_ylabel("difference / peak")
    handles = [plt.Line2D([], [], color="#1a1a1a", label="microslip")]
    handles += [
        plt.Line2D([], [], ls="", marker=marker, mfc="none", mec=colour, label=name) for name, (colour, marker) in LOOKS.items()
    ]
    handles += [
        plt.Line2D([], [], color="#8a8a8a", ls=ls, label=text) for ls, text in (("-", "the same law"), (":", "another law"))
    ]
    figure.legend(handles=handles, loc="lower center", ncols=6, fontsize=8, frameon=False)
    figure.tight_layout(rect=(0.0, 0.06, 1.0, 1.0))
    figure.savefig(path, dpi=150)


def _options():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", help="folder for the exports (default: a temporary one)")
    parser.add_argument("--cases", type=lambda text: text.split(","), default=[], help="names, with commas (default: all)")
    parser.add_argument("--nlvib", type=os.path.abspath, help="the folder SRC of NLvib; octave-cli runs it")
    parser.add_argument("--tmdsimpy", type=os.path.abspath, help="the folder of TMDSimPy")
    parser.add_argument("--python", type=os.path.abspath, help="an interpreter with pyHarm-os, psutil and jax")
    parser.add_argument("--others", action="store_true", help="also run programs whose law is another one")
    parser.add_argument("--picture", help="where to draw the curves")
    return parser.parse_args()


if __name__ == "__main__":
    main()
