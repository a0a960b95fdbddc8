"""A factor on disk: the stiffness of the bodies is freed and restored on demand, and no file remains."""

import gc
import shutil

import numpy as np
import pytest
from bar_scene import write_bar
from petsc4py import PETSc

import microslip
from microslip.linear import out_of_core
from microslip.linear.dense import gram, multiply
from microslip.messages.errors import ResourceError
from microslip.parallel.agree import on_root
from microslip.scene.read import changed

pytestmark = pytest.mark.ranks(1, 2)
ROUNDING = 1e-6
LEVEL = 30.0


@pytest.fixture
def scene(comm, shared_path):
    path = on_root(comm, lambda: write_bar(shared_path, modes=12, harmonics=3, samples=64))
    return changed(microslip.read(path), {"response": {"levels": [LEVEL], "points": 8}})


@pytest.fixture
def on_disk(comm, shared_path, monkeypatch):
    """Return the folder in which factors are stored, whatever the memory."""
    monkeypatch.setenv(out_of_core.VARIABLE, str(shared_path))
    PETSc.Options()["static_mat_mumps_icntl_22"] = 1
    yield shared_path
    PETSc.Options().delValue("static_mat_mumps_icntl_22")


def files(comm, folder):
    comm.Barrier()
    return list(folder.rglob(f"{out_of_core.PREFIX}*/*"))


def peak(response):
    (level,) = response.results.levels
    return np.abs(level.response).max()


@pytest.mark.parametrize("method", ["receptance", "rubin"])
def test_a_response_without_the_stored_stiffness_is_the_same(comm, scene, on_disk, method):
    with microslip.build(scene, comm) as structure:
        K, linearised = structure.linearised.system.K, structure.linearised
        assert linearised.factor.info["out_of_core"] and not K and files(comm, on_disk)
        without = peak(microslip.respond(structure, method=method))
        assert bool(K) == (method == "rubin")  # which needs the stiffness of the bodies
        linearised.bring_K_back()
        phi_owned = structure.modes.phi_owned
        products = gram(comm, phi_owned, multiply(K, phi_owned))
    PETSc.Options().delValue("static_mat_mumps_icntl_22")
    with microslip.build(scene, comm) as structure:
        K = structure.linearised.system.K
        assert K and not structure.linearised.factor.info["out_of_core"]
        assert without == pytest.approx(peak(microslip.respond(structure, method=method)), rel=ROUNDING)
        wanted = gram(comm, phi_owned, multiply(K, phi_owned))
    assert np.abs(products - wanted).max() <= 1e-12 * np.abs(wanted).max()


@pytest.mark.parametrize("changes", [{"method": "craig-bampton"}, {"verify_modes": False}])
def test_the_stiffness_is_stored_only_if_the_method_needs_it(comm, scene, on_disk, changes):
    with microslip.build(changed(scene, {"solver": changes}), comm) as structure:
        assert bool(structure.linearised.system.K) == ("method" in changes)


def test_no_factor_file_remains(comm, scene, on_disk):
    with microslip.build(scene, comm):
        assert files(comm, on_disk)
    gc.collect()
    comm.Barrier()
    assert not list(on_disk.glob(f"{out_of_core.PREFIX}*"))


def test_no_factor_file_remains_of_a_failed_run(comm, scene, on_disk, monkeypatch):
    def refused(*_):
        raise ResourceError("not enough memory for modes")

    monkeypatch.setattr("microslip.library.build.refuse_modes", refused)
    with pytest.raises(ResourceError, match="modes"):
        microslip.build(scene, comm)
    gc.collect()
    comm.Barrier()
    assert not list(on_disk.glob(f"{out_of_core.PREFIX}*"))


def test_a_file_name_too_long_for_mumps_is_rejected(comm, scene, on_disk, monkeypatch):
    long = on_disk / ("long" * 50) / ("name" * 20)
    on_root(comm, lambda: long.mkdir(parents=True, exist_ok=True))
    monkeypatch.setenv(out_of_core.VARIABLE, str(long))
    with pytest.raises(ResourceError, match=r"cannot be written \(.*MUMPS takes 255\); set MUMPS_OOC_TMPDIR"):
        microslip.build(scene, comm)
    comm.Barrier()
    on_root(comm, lambda: shutil.rmtree(long))
