"""A user's NumPy that does not match PETSc is reported with a remedy, instead of pages of text."""

import importlib
import site

import numpy
import pytest

from microslip.program import doctor


class ForAnotherNumPy:
    """The petsc4py.lib of a PETSc built for another NumPy."""

    @staticmethod
    def ImportPETSc():
        raise ValueError("numpy.dtype size changed, may indicate binary incompatibility")


@pytest.fixture
def other_numpy(monkeypatch, tmp_path):
    """Make NumPy one of a folder, for which PETSc was not built."""
    load = importlib.import_module
    monkeypatch.setattr(numpy, "__file__", str(tmp_path / "numpy" / "__init__.py"))
    monkeypatch.setattr(doctor.importlib, "import_module", lambda name: ForAnotherNumPy if name == "petsc4py.lib" else load(name))
    return tmp_path


def test_a_numpy_of_pythonpath_is_reported(monkeypatch, other_numpy):
    monkeypatch.setenv("PYTHONPATH", f"/elsewhere:{other_numpy}")
    assert doctor.faults("h5py") == (
        f"numpy: version {numpy.__version__} in {other_numpy / 'numpy'} is not the one that PETSc was built for: "
        "take that folder out of PYTHONPATH"
    )
    lines, is_well = doctor.examine()
    assert not is_well and "take that folder out of PYTHONPATH" in lines[1] and not any("scipy" in line for line in lines)


def test_a_numpy_of_the_home_folder_is_reported(monkeypatch, other_numpy):
    monkeypatch.delenv("PYTHONPATH", raising=False)
    monkeypatch.setattr(site, "ENABLE_USER_SITE", True)
    monkeypatch.setattr(site, "getusersitepackages", lambda: str(other_numpy))
    assert doctor.faults().endswith("start with PYTHONNOUSERSITE=1 in the environment, or pip uninstall numpy")


def test_a_numpy_of_another_folder_is_no_fault(monkeypatch, other_numpy):
    monkeypatch.delenv("PYTHONPATH", raising=False)
    assert doctor.faults("mpirun") is None
