"""The log of a run states which library did each part: other solvers, and parts of an earlier run, are named."""

import re
from pathlib import Path

import numpy as np
import pymetis
import pytest
from bar_scene import write_bar
from mpi4py import MPI
from petsc4py import PETSc
from sources import ROOT

from microslip.parallel import metis
from microslip.parallel.agree import on_root
from microslip.restart import cache
from microslip.results.read import read_results
from microslip.run import RunOptions, run
from microslip.scene.read import read_scene
from microslip.system.versions import versions

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
SMALL, LARGE = (4, 2, 1), (8, 3, 2)  # up to 400 DOF, by LAPACK, and more
FEW = ("response.levels=[30.0]", "response.span=[0.98, 1.02]", "response.points=5")
SHORT = ("solver.harmonics=1", "solver.samples=32", "solver.modes=6", "solver.error_bars=false")


@pytest.fixture(autouse=True)
def with_a_cache_and_without_pictures(monkeypatch, shared_path):
    monkeypatch.setenv(cache.VARIABLE, str(shared_path / "cache"))
    monkeypatch.setattr("microslip.results.draw.draw_share", lambda *share: None)


def parts_of_run(folder: Path, name: str = "first", *settings: str, divisions=LARGE) -> dict[str, str]:
    """Return the part of each library in the log of a run of the bar; runs of a folder share its cache."""
    path = on_root(
        COMM, lambda: folder / "bar.toml" if (folder / "bar.toml").is_file() else write_bar(folder, divisions=divisions)
    )
    run(read_scene(path, (*FEW, *settings)), COMM, folder / name, RunOptions(screen=False))
    log = on_root(COMM, (folder / name / "run.log").read_text)
    (block,) = re.findall(r"^libraries of this run:\n((?:  .*\n)+)", log, flags=re.M)
    return dict(line.split(maxsplit=1) for line in block.splitlines())


def test_the_log_of_a_default_run_names_the_library_of_each_part(shared_path, monkeypatch):
    calls = []
    for name in ("nested_dissection", "part_graph"):
        of_metis = getattr(pymetis, name)
        monkeypatch.setattr(pymetis, name, lambda *a, of=of_metis, name=name, **k: calls.append(name) or of(*a, **k))
    parts, version = parts_of_run(shared_path), versions()
    assert parts["matrices"].startswith(f"PETSc {version['PETSc']} {'seqaij' if COMM.size == 1 else 'mpiaij'}, ")
    assert int(parts["matrices"].split()[-2]) > 400
    assert parts["partition"] == ("none on one rank" if COMM.size == 1 else f"METIS, {COMM.size} ranks")
    assert parts["factor"] == f"MUMPS {version['MUMPS']} Cholesky"
    assert parts["order"] == "METIS"
    assert COMM.bcast(set(calls)) == {"nested_dissection"} | ({"part_graph"} if COMM.size > 1 else set())
    assert parts["modes"] == f"SLEPc {version['SLEPc']} krylovschur"
    assert parts["files"] == f"HDF5 {version['HDF5']}, results.h5"
    (level,) = on_root(COMM, read_results, str(shared_path / "first" / "results.h5")).levels
    newton = np.asarray(level.newton)
    assert np.count_nonzero(newton) > 0
    where = f"SNES newtonls at {np.count_nonzero(newton)} of {len(newton)}"
    assert parts["points"] == f"{where}, {newton.sum()} Newton and {sum(level.krylov)} Krylov iterations"
    page = (
        (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8").split("## Which library does what")[1].split("\n## ")[0]
    )
    assert list(parts) == re.findall(r"^\| `(\w+)` \|", page, flags=re.M)


@pytest.mark.ranks(1)
def test_cached_modes_and_factor_are_named_as_such(shared_path):
    parts_of_run(shared_path, "first", *SHORT)
    cached = parts_of_run(shared_path, "second", *SHORT, "joints.joint.friction=0.04")
    assert cached["matrices"].startswith("PETSc ") and cached["modes"] == "from an earlier run"
    assert cached["factor"].startswith("MUMPS ") and cached["factor"].endswith(" Cholesky, from an earlier run")
    assert cached["order"] == "METIS, from an earlier run"
    assert cached["points"].startswith("SNES newtonls at ")
    small = parts_of_run(shared_path, "third", *SHORT, "response.levels=[0.01]", "response.fields=false")
    for part in ("matrices", "factor", "order", "modes"):
        assert small[part] == "from an earlier run, in its reduced model"


def test_parts_by_another_library_or_none_are_named_as_such(shared_path, monkeypatch):
    options = PETSc.Options("static_")
    options["pc_type"] = "lu"
    if COMM.size == 1:
        options["pc_factor_mat_solver_type"] = "petsc"
    monkeypatch.setattr("microslip.library.libraries.h5py.is_hdf5", lambda path: False)
    try:
        parts = parts_of_run(shared_path, "first", *SHORT, "response.levels=[0.01]", divisions=SMALL)
    finally:
        options.delValue("pc_type")
        options.delValue("pc_factor_mat_solver_type")
    assert parts["modes"] == "LAPACK"
    assert re.fullmatch(r"no Newton iteration at \d+ points", parts["points"])
    assert parts["files"] == "no results.h5"
    assert parts["factor"] == parts["order"] == f"{'petsc' if COMM.size == 1 else 'mumps'}, by PETSc's options"


def test_another_nonlinear_solver_is_named_by_its_snes_name(shared_path):
    options = PETSc.Options("hb_")
    options["snes_type"] = "newtontr"
    try:
        parts = parts_of_run(shared_path, "first", *SHORT, divisions=SMALL)
    finally:
        options.delValue("snes_type")
    assert parts["points"].startswith("SNES newtontr at ")


@pytest.mark.ranks(2)
def test_the_partition_is_named_by_its_library(shared_path, monkeypatch):
    def halves(graph, n_parts, weights):
        return np.arange(graph.shape[0]) * n_parts // graph.shape[0]

    monkeypatch.setattr(metis, "partition", halves)
    monkeypatch.setattr(metis, "NAME", "halves")
    parts = parts_of_run(shared_path, "first", *SHORT, "response.levels=[0.01]", divisions=SMALL)
    assert parts["partition"] == "halves, 2 ranks"
