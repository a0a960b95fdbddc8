"""A factor on disk: the stiffness of the bodies alone is let go, comes back for who asks for it, and no file is left."""

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
    """The folder in which factors are kept from now on, whatever the memory."""
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
def test_a_structure_without_its_stiffness_answers_as_one_with_it(comm, scene, on_disk, method):
    with microslip.build(scene, comm) as structure:
        K, linearised = structure.linearised.system.K, structure.linearised
        assert linearised.factor.info["out_of_core"] and not K and files(comm, on_disk)
        without = peak(microslip.respond(structure, method=method))
        assert bool(K) == (method == "rubin")  # which starts from the bodies alone
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
def test_what_is_asked_for_from_the_start_keeps_it_or_not(comm, scene, on_disk, changes):
    with microslip.build(changed(scene, {"solver": changes}), comm) as structure:
        assert bool(structure.linearised.system.K) == ("method" in changes)


def test_no_file_is_left_behind(comm, scene, on_disk):
    with microslip.build(scene, comm):
        assert files(comm, on_disk)
    gc.collect()
    comm.Barrier()
    assert not list(on_disk.glob(f"{out_of_core.PREFIX}*"))


def test_nor_by_a_run_that_is_refused(comm, scene, on_disk, monkeypatch):
    def refused(*_):
        raise ResourceError("not enough memory for modes")

    monkeypatch.setattr("microslip.library.build.refuse_modes", refused)
    with pytest.raises(ResourceError, match="modes"):
        microslip.build(scene, comm)
    gc.collect()
    comm.Barrier()
    assert not list(on_disk.glob(f"{out_of_core.PREFIX}*"))


def test_a_name_that_mumps_has_no_room_for_is_refused(comm, scene, on_disk, monkeypatch):
    long = on_disk / ("long" * 50) / ("name" * 20)
    on_root(comm, lambda: long.mkdir(parents=True, exist_ok=True))
    monkeypatch.setenv(out_of_core.VARIABLE, str(long))
    with pytest.raises(ResourceError, match=r"cannot be written \(.*MUMPS takes 255\); set MUMPS_OOC_TMPDIR"):
        microslip.build(scene, comm)
    comm.Barrier()
    on_root(comm, lambda: shutil.rmtree(long))
