"""Scenes given as matrices: the systems of tests/oracles/scenes.py as files, and the branches of such a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy.io
import scipy.sparse as sp
from scene_text import with_harmonics

from microslip.assembly.pair_file import COLUMNS
from microslip.library.build import build
from microslip.library.follow_response import follow
from microslip.library.prepare import prepare
from microslip.library.result_files import writer_of
from microslip.observe.log import RunLog
from microslip.scene.read import read_scene

HZ = 2.0 * np.pi


def write_matrix_scene(folder: Path, system: dict, levels, frequencies, *, at=(), outputs=None, **solver) -> Path:
    """Write a system as K.mtx, M.mtx, C.mtx, pairs.csv and scene.toml; return the scene's path.

    ``frequencies`` and ``at`` in rad/s; every DOF is an output unless ``outputs`` names some; ``points`` and ``direction``
    go to [response], all other keys to [solver], where harmonics = 3 unless harmonics or accuracy are given.
    """
    for name in {"K", "M", "C"} & set(system):
        matrix = system[name] if sp.issparse(system[name]) else np.asarray(system[name], dtype=float)
        scipy.io.mmwrite(folder / f"{name}.mtx", matrix, precision=17)
    (folder / "pairs.csv").write_text("\n".join([",".join(COLUMNS), *_pair_lines(system)]) + "\n")
    path = folder / "scene.toml"
    path.write_text("\n".join([*_model(system), *_places(system, outputs), *_response(levels, frequencies, at, solver)]) + "\n")
    return path


def _pair_lines(system: dict) -> list[str]:
    N0, k_n = system["N0"], system["k_n"]
    gap = np.divide(-N0, k_n, out=np.zeros_like(k_n), where=N0 < 0.0)
    columns = [system["mu"], np.maximum(N0, 0.0), gap, system["k_t"], k_n]
    return [
        ",".join([*map(str, dofs), *(repr(float(x)) for x in numbers)])
        for dofs, numbers in zip(system["pair_dofs"], zip(*columns))
    ]


def _model(system: dict) -> list[str]:
    lines = ["[model]", 'stiffness = "K.mtx"', 'mass = "M.mtx"']
    own = f"ratio = {system['zeta']}" if "zeta" in system else f"rayleigh = {list(system.get('rayleigh', ()))}"
    lines += ['damping = "C.mtx"'] if "C" in system else ["[damping]", own]
    limit = "separate" if system["separate"].any() else "circle"
    return [*lines, "[[joints]]", 'name = "joint"', 'pairs = "pairs.csv"', f'friction_limit = "{limit}"']


def _places(system: dict, outputs) -> list[str]:
    lines = []
    for load in system["loads"]:
        for dof in np.flatnonzero(load["vector"]):
            lines += [
                "[[loads]]",
                f"dof = {dof}",
                f"scale = {float(load['vector'][dof])!r}",
                f"harmonic = {load['harmonic']}",
                f"phase = {load.get('phase', 0.0)!r}",
            ]
    for dof in range(len(system["M"])) if outputs is None else outputs:
        lines += ["[[outputs]]", f'name = "{dof}"', f"dof = {dof}"]
    return lines


def _response(levels, frequencies, at, solver: dict) -> list[str]:
    own = {key: solver.pop(key) for key in ("points", "direction") if key in solver}
    hertz = {"frequencies": [float(w) / HZ for w in frequencies], "at": [float(w) / HZ for w in at]}
    response = {"levels": [float(level) for level in levels], **hertz, **own}
    return ["[response]", *_keys(response), "[solver]", *_keys(with_harmonics(solver))]


def _keys(table: dict) -> list[str]:
    return [f"{key} = {str(value).lower() if isinstance(value, bool) else repr(value)}" for key, value in table.items()]


def branches_of(path: Path, comm) -> list:
    """Return the branches of every level of a scene file, by the stages of ``microslip run`` up to results.h5.  Collective."""
    scene = read_scene(path)
    log = RunLog(comm, screen=False)
    structure = build(scene, comm, log)
    prepared = prepare(structure, has_bars=False)
    writer = writer_of(prepared, path.parent / "results")
    computed = follow(prepared.response, [writer], log=log)
    writer.close()
    structure.close()
    assert not any(branch.failure for branch in computed), [branch.failure for branch in computed]
    return computed


def requested(branch) -> list:
    """Return the points of a branch at the frequencies of [response] ``at``."""
    return [point for point in branch.points if point.requested]
