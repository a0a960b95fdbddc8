"""Without the bridge to MUMPS: factors, counts of modes and a run by the interface of PETSc, and unavailable functions."""

import sys

import h5py
import lattices
import numpy as np
import pytest
import scipy.sparse as sp
from bar_scene import write_bar
from lattices import distributed, split_rows
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse.linalg import spsolve

from microslip.guards import memory
from microslip.linear import bridge, direct, other_package
from microslip.linear.factor import Factor
from microslip.messages.errors import CaseError, ConvergenceError, ResourceError
from microslip.modes.inertia import count_below
from microslip.parallel.agree import on_root
from microslip.restart import cache
from microslip.results.read import read_results
from microslip.run import RunOptions, run
from microslip.scene.read import read_scene
from microslip.system.memory import Limit

pytestmark = pytest.mark.ranks(1, 2)
comm = MPI.COMM_WORLD
K = lattices.lattice_stiffness((12, 6, 5))
N = K.shape[0]


def matrix(A=K, empty=None):
    A = distributed(comm, sp.csr_matrix(A), split_rows(A.shape[0], comm.size, empty))
    A.setOption(PETSc.Mat.Option.SPD, True)
    return A


@pytest.fixture
def by_petsc(monkeypatch):
    monkeypatch.setenv(bridge.VARIABLE, "petsc")


@pytest.mark.parametrize("empty", [None, 0, 1])
def test_solves_are_exact_and_entries_of_the_inverse_unavailable(by_petsc, empty):
    A = matrix(empty=empty)
    factor = Factor(A, last=np.arange(9))
    assert isinstance(factor.solver, other_package.PackageFactor) and factor.info["package"] == "mumps"
    B = np.random.default_rng(1).standard_normal((N, 3))
    owned, X = slice(*A.getOwnershipRange()), spsolve(K.tocsc(), B)
    np.testing.assert_allclose(factor.solve(B[owned]), X[owned], atol=1e-11 * abs(X).max())
    np.testing.assert_allclose(factor.solve(sp.csc_matrix(B)), X[owned], atol=1e-11 * abs(X).max())
    assert factor.inverse_entries(np.arange(3), np.arange(3)) is None and factor.solver.order is None
    factor.destroy()


def test_signs_of_pivots_count_modes_below_a_shift(by_petsc):
    """Units of rows from 1e-6 to 1e6 do not matter; sigma at an eigenvalue is an error."""
    squares = np.linalg.eigvalsh(K.toarray())
    sigma = 0.5 * (squares[9] + squares[10])
    units = sp.diags(10.0 ** np.random.default_rng(0).integers(-6, 7, N))
    for scale in (sp.identity(N), units):
        assert count_below(matrix(scale @ K @ scale), matrix(scale @ scale), sigma) == 10
    with pytest.raises(ConvergenceError, match="singular at sigma"):
        count_below(matrix(sp.diags(np.arange(1.0, 8.0))), matrix(sp.identity(7)), 3.0)


def test_an_indefinite_matrix_has_no_factor(by_petsc):
    with pytest.raises(CaseError, match="not positive definite"):
        Factor(matrix(K - 1.001 * np.linalg.eigvalsh(K.toarray())[3] * sp.identity(N)))


def test_too_little_workspace_is_increased(by_petsc, monkeypatch):
    large, controls = lattices.lattice_stiffness((14, 9, 8)), other_package.CONTROLS
    monkeypatch.setattr(other_package, "CONTROLS", (*controls, (14, -70)))
    factor = Factor(matrix(large))
    (message,) = factor.info["messages"]
    assert "INFOG(1) = -9" in message or "INFOG(1) = -8" in message
    assert "again with 60 % of workspace" in message
    factor.destroy()
    monkeypatch.setattr(other_package, "RELAXATION", (-70,))
    with pytest.raises(ResourceError, match="not enough memory for its factor"):
        Factor(matrix(large))


def test_memory_is_predicted(by_petsc, monkeypatch):
    """The prediction is close to that of the bridge, which has another order; without memory nothing is factored."""
    A = matrix(lattices.lattice_stiffness((30, 12, 10)))
    needed, factor = other_package.foreseen(A, "static_"), Factor(A)
    info = factor.info
    assert needed == info["memory"] and info["memory_MB"] > 0 and needed.entries == pytest.approx(info["entries"], rel=0.2)
    assert comm.allreduce(needed.in_core) == pytest.approx(1e6 * info["memory_MB"], rel=0.5)
    of_nodes = [direct.foreseen(A, 3, 10_000)]
    monkeypatch.delenv(bridge.VARIABLE)
    of_nodes.append(direct.foreseen(A, 3, 10_000))
    assert of_nodes[0].entries == pytest.approx(of_nodes[1].entries, rel=0.5)
    monkeypatch.setenv(bridge.VARIABLE, "petsc")
    monkeypatch.setattr(memory, "limits_here", lambda machine, process, resident: [Limit("the test", machine, 1e6)])
    monkeypatch.setattr(other_package, "_attempt", None)
    with pytest.raises(ResourceError, match="its factor .* unknowns.: not enough memory"):
        Factor(A)
    factor.destroy()


def test_mumps_is_set_to_order_by_metis(by_petsc, options):
    """MUMPS built without METIS uses another order; an order by an option has priority."""
    A = matrix()
    with_metis, _ = other_package.factorise(A, "static_", "A", None)
    assert with_metis.ksp.getPC().getFactorMatrix().getMumpsIcntl(7) == 5
    options(static_mat_mumps_icntl_7=4)
    with_pord, info = other_package.factorise(A, "static_", "A", None)
    assert info["ordering"] == "PORD"
    with_metis.destroy()
    with_pord.destroy()


def test_a_factor_on_disk_is_refused(by_petsc, options):
    options(static_mat_mumps_icntl_22=1)
    with pytest.raises(CaseError, match="factors on disk need the bridge to MUMPS.*microslip doctor"):
        Factor(matrix())


def test_a_missing_bridge_is_reported(monkeypatch):
    monkeypatch.delenv(bridge.VARIABLE, raising=False)
    assert bridge.is_there(comm)
    monkeypatch.setitem(sys.modules, "microslip.linear._mumps", None)
    assert "installed without MUMPS' headers" in bridge.missing() and not bridge.is_there(comm)
    monkeypatch.setenv(bridge.VARIABLE, "bridge")
    with pytest.raises(CaseError, match="MICROSLIP_MUMPS=bridge: .*without MUMPS' headers"):
        bridge.is_there(comm)
    monkeypatch.setenv(bridge.VARIABLE, "other")
    with pytest.raises(CaseError, match="MICROSLIP_MUMPS=other: it is one of bridge, petsc"):
        bridge.is_there(comm)


def test_no_rank_uses_the_bridge_if_one_has_none(monkeypatch):
    if comm.rank == comm.size - 1:
        monkeypatch.setenv(bridge.VARIABLE, "petsc")
    factor = Factor(matrix())
    assert isinstance(factor.solver, other_package.PackageFactor)
    factor.destroy()


def test_a_number_beyond_32_bits_is_refused():
    assert [bridge.within_int32(number, "unknowns") for number in (0, 2**31 - 1)] == [0, 2**31 - 1]
    for number in (2**31, -1, 2**40):
        with pytest.raises(ResourceError, match=f"{number} unknowns: MUMPS' integers end at 2147483647"):
            bridge.within_int32(number, "unknowns")


@pytest.mark.slow
def test_a_run_without_the_bridge_gives_the_same_curve_and_modes(shared_path, monkeypatch):
    """Without the module no factor is cached, and a cached factor is not used."""
    path = on_root(comm, lambda: write_bar(shared_path, divisions=(8, 3, 2), modes=6))
    scene = read_scene(path, ("response.span=[0.98, 1.02]", "response.points=5", "solver.harmonics=1", "solver.samples=32"))
    monkeypatch.setattr("microslip.results.plots.draw_all", lambda *files: [])
    for name, cached in (("bridge", "one"), ("petsc", "two"), ("petsc_later", "one")):
        with monkeypatch.context() as patch:
            if name != "bridge":
                patch.setitem(sys.modules, "microslip.linear._mumps", None)
            patch.setenv(cache.VARIABLE, str(shared_path / cached))
            run(scene, comm, shared_path / name, RunOptions(screen=False))
    if comm.rank > 0:
        return
    assert list((shared_path / "one").glob("setup-*/factor-*/factor_0.mumps"))
    assert list((shared_path / "two").glob("setup-*/model")) and not list((shared_path / "two").glob("setup-*/factor-*"))
    curve, frequencies, shapes = results_in(shared_path / "bridge")
    for name in ("petsc", "petsc_later"):
        assert "factor by PETSc's interface to MUMPS: " in (shared_path / name / "run.log").read_text()
        curve_here, frequencies_here, shapes_here = results_in(shared_path / name)
        np.testing.assert_allclose(curve_here, curve, rtol=0, atol=1e-8 * np.abs(curve).max())
        np.testing.assert_allclose(frequencies_here, frequencies, rtol=1e-9)
        signs = np.sign(np.einsum("mij,mij->m", shapes_here, shapes))[:, None, None]
        np.testing.assert_allclose(signs * shapes_here, shapes, rtol=0, atol=1e-6 * np.abs(shapes).max())


def results_in(folder):
    """Return curve, frequencies and shapes of the modes of a run.  Rank 0."""
    with h5py.File(folder / "results.h5") as file:
        frequencies, shapes = file["modes/frequency_Hz"][()], file["modes/shape"][()]
    return read_results(str(folder / "results.h5")).levels[0].response, frequencies, shapes
