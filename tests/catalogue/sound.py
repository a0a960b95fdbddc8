"""The sound files that the catalogue spoils: scenes, models of every format, matrices, tables, results of an earlier run."""

from __future__ import annotations

import hashlib
import shutil
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
from block_scenes import NODE_PAIRS, in_format
from block_scenes import write_scene as write_blocks
from blocks import block
from discs import sector, write_sector
from lap_scene import SCENE, write_mesh
from matrix_scenes import write_matrix_scene
from msh import write_msh
from oracles.scenes import chain
from plain_model import DENSITY, POISSON, YOUNG, bdf, cdb, exodus, inp, plain, tables, unv
from synthetic_results import branch, two_flanks, write

from microslip.scene.toml_text import as_toml

EARLIER = "out"  # folder of the results of an earlier run, which must not change
MODELS = ("inp", "cdb", "bdf", "unv", "exo", "e", "vtu")


def write_sound(folder: Path) -> None:
    """Write all sound files.  Local."""
    write_mesh(folder / "lap.msh")
    (folder / "lap.toml").write_text(SCENE)
    _write_chain(folder)
    _write_disc(folder)
    _write_blocks(folder / "blocks")
    _write_models(folder)
    _write_results(folder / EARLIER)
    shutil.copy(folder / EARLIER / "results.h5", folder / "copy.h5")


def _write_chain(folder: Path) -> None:
    """Write chain.toml with K.mtx, M.mtx and pairs.csv."""
    system = chain()
    write_matrix_scene(folder, system, [10.0], (500.0, 600.0), outputs=[6], points=8, harmonics=1).rename(folder / "chain.toml")


def _write_disc(folder: Path) -> None:
    """Write disc.toml with the mesh of a shrouded sector, bent.msh with a displaced node, and pie.msh up to the axis."""
    end = "[damping]\nratio = 0.01\n[response]\nlevels = [10.0]\nfrequencies = [1400.0, 1500.0]\npoints = 8\n"
    end += "[solver]\nmodes = 8\nharmonics = 1\nerror_bars = false\n"
    write_sector(folder, 5, end, name="disc", how={"shroud": True})
    bodies = sector("hex8", 5, shroud=True)
    points = bodies["disc"].points.copy()
    points[bodies["disc"].face_nodes("high0")[-1], 2] += 3e-3
    write_msh(str(folder / "bent.msh"), bodies | {"disc": replace(bodies["disc"], points=points)})
    a, b = (0.04 * np.array([np.cos(angle), np.sin(angle), 0.0]) for angle in (0.0, 0.4 * np.pi))

    def pie(u, v, w):
        return u[:, None] * a + v[:, None] * b + w[:, None] * [0.0, 0.0, 0.01]

    core = block("hex8", pie, (1, 1, 1), {"y0": "pie_low", "x0": "pie_high"})
    write_msh(str(folder / "pie.msh"), bodies | {"core": core})


def _write_blocks(folder: Path) -> None:
    """Write matrices whose rows belong to nodes, with dofs.csv and pairs of nodes."""
    folder.mkdir()
    write_blocks(folder, in_format(folder, "mtx"), NODE_PAIRS)


def _write_models(folder: Path) -> None:
    """Write the bar on a plate in the formats of other programs, each with a scene."""
    model = plain()
    for ending, text in (("inp", inp), ("cdb", cdb), ("bdf", bdf), ("unv", unv)):
        (folder / f"bar.{ending}").write_text(text(model))
    exodus(model, folder / "bar.exo")
    exodus(model, folder / "bar.e", hdf5=True)
    _write_vtu(model, folder / "bar.vtu")
    steel = {"young": YOUNG, "poisson": POISSON, "density": DENSITY}
    rest = {
        "materials": {"steel": steel},
        "bodies": {name: {"group": name, "material": "steel"} for name in ("bar", "plate")},
        "supports": ({"group": "PLATE_BASE", "fix": ("x", "y", "z")},),
    }
    for ending in MODELS:
        stated = {} if ending in ("inp", "cdb", "bdf") else rest
        (folder / f"bar_{ending}.toml").write_text(as_toml({**tables(f"bar.{ending}"), **stated}))


def _write_vtu(model, path: Path) -> None:
    meshio.write(path, meshio.Mesh(model.points, [("hexahedron", np.concatenate(model.elements))]))


def _write_results(folder: Path) -> None:
    """Write results of an earlier run."""
    folder.mkdir()
    pairs = two_flanks(3, 1)
    write(folder, [branch(level, pairs, n_points=20) for level in (1.0, 8.0)], pairs)
    for name in ("response.png", "report.html"):
        (folder / name).write_bytes(b"of an earlier run")


def fingerprint(folder: Path) -> dict[str, str]:
    """Return a digest of each file of results in a folder, without logs, to detect changes.  Local."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.suffix != ".log"]
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
