"""A factor with insufficient memory: forecast, factor on disk, retries, and the same error on all ranks."""

from pathlib import Path

import lattices
import numpy as np
import pytest
from lattices import distributed, split_rows
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse.linalg import spsolve

from microslip.guards import memory
from microslip.linear import mumps, out_of_core
from microslip.linear.analysis import count, factor_memory
from microslip.linear.factor import Factor
from microslip.messages.errors import CaseError, ResourceError
from microslip.system.memory import Limit

pytestmark = pytest.mark.ranks(1, 2)
comm = MPI.COMM_WORLD
K = lattices.lattice_stiffness((24, 12, 10))


@pytest.fixture
def A():
    matrix = distributed(comm, K, split_rows(K.shape[0], comm.size))
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    yield matrix
    matrix.destroy()


def limit_memory(monkeypatch, free):
    monkeypatch.setattr(memory, "limits_here", lambda machine, process, resident: [Limit("the test", process, free)])


def solves(factor):
    b = np.random.default_rng(1).standard_normal((K.shape[0], 3))
    owned = slice(*factor.A.getOwnershipRange())
    x_owned = factor.solve(b[owned])
    residual = factor.relative_residual(b[owned], x_owned)[0]
    return residual < 1e-9


def foreseen(A):
    analysed = mumps.analysed(A, "static_", "K")
    memory = factor_memory(analysed.mumps)
    analysed.destroy()
    return memory


def test_the_analysis_predicts_the_memory_of_the_factor(A, monkeypatch):
    forecast = foreseen(A)
    factor = Factor(A)
    assert comm.allreduce(forecast.in_core) == pytest.approx(1e6 * factor.info["memory_MB"], rel=0.3)
    assert forecast.entries == pytest.approx(factor.info["entries"], rel=0.01)
    assert 0.0 < forecast.out_of_core < forecast.in_core and comm.allreduce(forecast.on_disk) >= 8.0 * factor.info["entries"]
    assert factor.info["messages"] == () and not factor.info["out_of_core"]
    factor.destroy()


def test_a_factor_that_does_not_fit_is_stored_on_disk(A, monkeypatch, tmp_path):
    forecast, folder = foreseen(A), comm.bcast(str(tmp_path))
    monkeypatch.setenv(out_of_core.VARIABLE, folder)
    monkeypatch.setattr(out_of_core, "_is_on_disk", lambda folder: True)
    limit_memory(monkeypatch, 0.5 * (forecast.in_core + forecast.out_of_core))
    factor = Factor(A)
    assert factor.info["out_of_core"] and "does not fit into memory (one rank needs" in factor.info["messages"][0]
    assert list(Path(folder).rglob("mumps_*"))
    assert solves(factor)
    factor.destroy()
    comm.Barrier()
    assert not list(Path(folder).rglob("mumps_*"))


def test_entries_of_the_inverse_from_a_factor_on_disk_are_exact(A, options):
    options(static_mat_mumps_icntl_22=1)
    factor = Factor(A)
    rows, columns = np.array([0, 5, 9]), np.array([0, 7])
    entries = factor.inverse_entries(rows, columns)
    if comm.rank == 0:
        expected = spsolve(K.tocsc(), np.eye(K.shape[0])[:, columns])[rows]
        np.testing.assert_allclose(entries, expected, rtol=1e-9, atol=1e-18)
    factor.destroy()


@pytest.mark.parametrize("why", ["memory", "disk"])
def test_insufficient_memory_and_disk_are_an_error_before_the_factorisation(A, monkeypatch, why):
    forecast = foreseen(A)
    limit_memory(monkeypatch, 1.0 if why == "memory" else 0.5 * (forecast.in_core + forecast.out_of_core))
    monkeypatch.setattr(out_of_core, "_is_on_disk", lambda folder: why == "memory")
    message = (
        "on disk it would still be so"
        if why == "memory"
        else r"nor is there room for .* \(\$MUMPS_OOC_TMPDIR names another folder\)"
    )
    with pytest.raises(ResourceError, match=f"K_L: not enough memory for its factor.*{message}.*use more ranks on more machines"):
        Factor(A)


def test_memory_of_later_stages_moves_a_factor_to_disk(A, monkeypatch, tmp_path):
    """The factor fits into memory, but not together with later stages."""
    forecast = foreseen(A)
    monkeypatch.setenv(out_of_core.VARIABLE, comm.bcast(str(tmp_path)))
    monkeypatch.setattr(out_of_core, "_is_on_disk", lambda folder: True)
    limit_memory(monkeypatch, 1.5 * forecast.in_core)
    factor = Factor(A, later=lambda memory: memory.in_core)
    assert factor.info["out_of_core"] and solves(factor)
    assert "does not fit into memory with what comes later (" in factor.info["messages"][0]
    factor.destroy()


def test_without_disk_a_factor_is_in_memory_in_spite_of_later_stages(A, monkeypatch):
    forecast = foreseen(A)
    limit_memory(monkeypatch, 1.5 * forecast.in_core)
    monkeypatch.setattr(out_of_core, "_is_on_disk", lambda folder: False)
    factor = Factor(A, later=lambda memory: memory.in_core)
    assert not factor.info["out_of_core"] and factor.info["messages"] == () and solves(factor)
    factor.destroy()


def test_a_file_system_in_memory_is_no_disk(monkeypatch):
    monkeypatch.setattr(out_of_core, "_mounts", lambda: [("/", "ext4"), ("/tmp", "tmpfs")])
    assert not out_of_core._is_on_disk("/tmp") and out_of_core._is_on_disk("/") and not out_of_core._is_on_disk("/nowhere")


def test_too_little_workspace_by_an_option_is_increased(A, options):
    """ICNTL(14) far below the need gives INFOG(1) = -8 or -9, and a second attempt with more workspace than the option."""
    options(static_mat_mumps_icntl_14=-60)
    factor = Factor(A)
    assert len(factor.info["messages"]) == 1
    assert "INFOG(1) = -9" in factor.info["messages"][0] and "again with 60 % of workspace" in factor.info["messages"][0]
    assert solves(factor)
    factor.destroy()


def test_a_memory_limit_by_an_option_is_named(A, options):
    options(static_mat_mumps_icntl_23=1)
    with pytest.raises(
        ResourceError, match=r"INFOG\(1\) = -(9|19).*use more ranks" if comm.size > 1 else "-static_mat_mumps_icntl_23"
    ):
        Factor(A)


def reported(monkeypatch, *codes):
    """Let MUMPS report these INFOG(1) of successive attempts; the last code applies to all further attempts."""
    report, attempts = mumps.report, []

    def failing(factor):
        attempts.append(codes[min(len(attempts), len(codes) - 1)])
        return report(factor) | {"code": attempts[-1], "detail": 7}

    monkeypatch.setattr(mumps, "report", failing)
    return attempts


def test_a_failed_allocation_moves_the_factor_to_disk(A, monkeypatch):
    attempts = reported(monkeypatch, -13, 0)
    factor = Factor(A)
    assert factor.info["out_of_core"] and attempts == [-13, 0]
    assert "INFOG(1) = -13, INFOG(2) = 7; again with the factor on disk" in factor.info["messages"][0] and solves(factor)
    factor.destroy()


@pytest.mark.slow
@pytest.mark.parametrize(
    "code, n_attempts, error, message",
    [
        (-8, 4, ResourceError, "not enough memory"),
        (-9, 4, ResourceError, "not enough memory"),
        (-11, 4, ResourceError, "not enough memory"),
        (-17, 4, ResourceError, "not enough memory"),
        (-5, 2, ResourceError, "not enough memory"),
        (-7, 2, ResourceError, "not enough memory"),
        (-13, 2, ResourceError, "not enough memory"),
        (-19, 2, ResourceError, "-static_mat_mumps_icntl_23 allows it too few MB"),
        (-90, 1, ResourceError, r"could not be written to disk.*\$MUMPS_OOC_TMPDIR"),
        (-53, 1, CaseError, "check the -static_mat_mumps options"),
    ],
)
def test_retries_end_with_the_same_message_on_all_ranks(A, monkeypatch, code, n_attempts, error, message):
    attempts = reported(monkeypatch, code)
    with pytest.raises(error, match=f"INFOG\\(1\\) = {code}") as caught:
        Factor(A)
    assert len(attempts) == n_attempts
    with pytest.raises(error, match=message):
        raise caught.value
    assert len(set(comm.allgather(str(caught.value)))) == 1


def test_a_solve_without_memory_is_a_resource_error(A, monkeypatch):
    factor = Factor(A)
    mumps_of_factor = factor.solver.mumps

    class Full:
        """MUMPS without memory for right-hand sides."""

        def __getattr__(self, name):
            return getattr(mumps_of_factor, name)

        def run(self, job):
            return -13

        def infog(self, number):
            return 99

    monkeypatch.setattr(factor.solver, "mumps", Full())
    with pytest.raises(ResourceError, match=r"a solve with the factor: not enough memory.*INFOG\(1\) = -13, INFOG\(2\) = 99"):
        factor.solve(np.ones((A.getLocalSize()[0], 1)))
    monkeypatch.undo()
    factor.destroy()


def test_negative_counts_of_mumps_are_millions():
    assert count(12) == 12 and count(-12) == 12_000_000
