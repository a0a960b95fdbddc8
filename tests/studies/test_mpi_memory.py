"""The forecast of memory by `check`: entries of the matrices and of the factor; and rejection by a run."""

import re
import tracemalloc

import lattices
import numpy as np
import pytest
import scipy.sparse as sp
from bar_scene import write_bar
from block_scenes import OF_CALCULIX, write_scene
from lap_scene import SCENE, write_mesh
from petsc4py import PETSc

from microslip.assembly.assemble import assemble, read_off
from microslip.assembly.constraints import constrain
from microslip.assembly.coupling import coupling_of_nodes
from microslip.guards import memory
from microslip.library.complete import read_completed
from microslip.linear.direct import foreseen
from microslip.linear.joint_springs import linearise
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.partition import distribute
from microslip.mesh.read import read_mesh
from microslip.messages.errors import ResourceError
from microslip.modes.rayleigh import _energies_of_all as energies_of_all
from microslip.parallel.agree import on_root
from microslip.reduction import stuck
from microslip.reduction.memory_of_modes import of_energies
from microslip.scene.read import read_scene
from microslip.system.memory import Limit

# the lap joint of the scene, tied
TIED = re.sub(r"\[\[joints\]\].*?(?=\[\[loads)", '[[ties]]\nsurfaces = ["lap_1", "lap_2"]\n', SCENE, flags=re.S)


def parts(comm, path):
    """Return the distributed mesh, mesh, pairs and settings of a scene.  Collective."""
    file, scene, _ = read_completed(read_scene(path), comm)
    mesh = on_root(comm, read_mesh, scene, file, share=False)
    pairs = on_root(comm, pair_contacts, mesh, scene.joints)
    return distribute(mesh, scene, comm), mesh, pairs, scene


def test_memory_of_the_eigenvalues_in_extended_precision_is_foreseen(comm):
    n, m = 30_000, 20
    A = lattices.distributed(comm, sp.identity(n, format="csr"), lattices.split_rows(n, comm.size))
    X_owned = np.ones((A.getLocalSize()[0], m))
    tracemalloc.start()
    energies_of_all([(A, X_owned)])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 0.7 * peak < of_energies(n, m) < 1.5 * peak
    A.destroy()


def entries(matrix):
    return matrix.getInfo(PETSc.Mat.InfoType.LOCAL)["nz_used"]


def test_entries_and_factor_are_those_of_the_matrices(comm, shared_path):
    """A bar of 900 nodes: entries of K without fixed rows, and of the factor within the effect of a finer graph."""
    path = on_root(comm, write_bar, shared_path, "ratio = 0.01", (16, 6, 6))
    dmesh, mesh, pairs, settings = parts(comm, path)
    coupling = coupling_of_nodes(dmesh, pairs)
    forecast = foreseen(coupling.graph, coupling.n_dof_each, coupling.entries_owned)
    coupling.graph.destroy()
    system = assemble(dmesh, mesh, pairs, settings)
    linearised = linearise(system, pairs)
    n_fixed = 3 * dmesh.node_ranges[-1] - system.n_dof
    assert coupling.n_dof == system.n_dof + n_fixed and n_fixed > 0
    assert comm.allreduce(entries(system.K)) < comm.allreduce(coupling.entries_owned) < 1.3 * comm.allreduce(entries(system.K))
    assert forecast.entries == pytest.approx(linearised.factor.info["entries"], rel=0.3)
    buffers = comm.size * (2e6 if comm.size == 1 else 8e6)  # of messages, whatever the size
    assert comm.allreduce(forecast.in_core) == pytest.approx(1e6 * linearised.factor.info["memory_MB"], rel=0.3, abs=buffers)
    linearised.destroy()


def test_following_nodes_are_eliminated_from_the_graph(comm, shared_path):
    def write():
        write_mesh(shared_path / "lap.msh")
        (shared_path / "lap.toml").write_text(TIED)

    on_root(comm, write)
    comm.Barrier()
    dmesh, mesh, pairs, settings = parts(comm, shared_path / "lap.toml")
    whole = on_root(comm, read_off, mesh, pairs, settings)
    is_fixed, links = whole.is_fixed, whole.links
    constraints = constrain(dmesh, links, is_fixed, *whole.loose)
    coupling = coupling_of_nodes(dmesh, pairs, constraints)
    system = assemble(dmesh, mesh, pairs, settings)
    assert len(links.dependent) > 0
    n_entries, n_coupled = comm.allreduce(entries(system.K)), comm.allreduce(coupling.entries_owned)
    assert n_entries <= n_coupled < 1.35 * n_entries
    coupling.graph.destroy()


@pytest.mark.parametrize("kind", ["mesh", "matrices"])
def test_check_lists_the_memory_of_every_stage(comm, shared_path, program, kind):
    write = (lambda: write_bar(shared_path)) if kind == "mesh" else (lambda: write_scene(shared_path, OF_CALCULIX))
    path = on_root(comm, write)
    status, messages, _ = program("check", path)
    assert status == 0
    lines = messages[messages.index("memory     peak by the end of each stage") :].splitlines()
    stages = {
        line[11:41].strip(): line[41:].split() for line in lines[1:] if line[41:].split() and line[41:].split()[0].isdigit()
    }
    assert list(stages)[1:] == ["assembly", "factor of the stuck structure", "modes", "reduction", "response", "pictures"]
    assert list(stages.values())[0][-1] == "measured"
    in_all = [float(numbers[0]) for numbers in stages.values()]
    assert 50.0 < in_all[0] and np.all(np.diff(in_all) >= 0.0)
    assert "for the factor" in messages and "this machine has" in lines[-1]


def limited(monkeypatch, left):
    monkeypatch.setattr(memory, "limits_here", lambda machine, process, resident: [Limit("the test", machine, left())])


@pytest.mark.parametrize(
    "n_asked, what", [(0, "assembly of the matrices"), (1, "K_L, the stiffness with all pairs stuck"), (2, "12 modes")]
)
def test_a_run_without_memory_ends_before_each_stage_with_status_4(comm, shared_path, program, monkeypatch, n_asked, what):
    """So many queries return enough memory, the next ones a single byte; the factor needs less than MUMPS states."""
    queries: list[int] = []

    def counting(machine, process, resident):
        queries.append(0)
        return [Limit("the test", machine, 1e12 if len(queries) <= n_asked else 1.0)]

    monkeypatch.setattr(memory, "limits_here", counting)
    path = on_root(comm, lambda: write_bar(shared_path, modes=12))
    status, _, errors = program("run", path, "--out", shared_path / "out")
    assert status == 4 and errors.count("microslip: error: ") == 1 and "Traceback" not in errors
    assert f"{what}" in errors and "but only 1e-06 MB of the test are left" in errors and "more ranks on more machines" in errors


def test_check_warns_if_a_run_would_lack_memory(comm, shared_path, program, monkeypatch):
    limited(monkeypatch, lambda: 1e6)
    status, messages, _ = program("check", on_root(comm, lambda: write_bar(shared_path)))
    assert status == 0 and "WARNING: too much for this machine: " in messages and "but only 1 MB of the test are left" in messages


def test_memory_of_many_static_columns_is_checked(comm, monkeypatch):
    system, pairs = lattices.lattice(comm)
    linearised = linearise(system, pairs)
    monkeypatch.setattr(stuck, "_CHECKED_FROM", 0.0)
    columns = stuck.static_response(linearised).G_static
    columns.require(np.array([0]))
    limited(monkeypatch, lambda: 1.0)
    with pytest.raises(
        ResourceError, match="static columns of 2 more pairs: not enough memory.*fewer pairs slip at lower .response. levels"
    ):
        columns.require(np.array([1, 2]))
    linearised.destroy()
