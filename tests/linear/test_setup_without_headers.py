"""setup.py builds the bridge to MUMPS only if it locates the headers of MUMPS."""

import importlib.util
from pathlib import Path

import pytest

pytestmark = pytest.mark.ranks(1)
SETUP = Path(__file__).parents[2] / "setup.py"


@pytest.fixture
def setup(monkeypatch):
    """Return setup.py as a module, without a build."""
    pytest.importorskip("Cython")
    spec = importlib.util.spec_from_file_location("microslip_setup", SETUP)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def names(extensions):
    return {extension.name for extension in extensions}


def test_without_headers_only_the_bridge_is_not_built(setup, monkeypatch, capsys):
    monkeypatch.setattr(setup, "headers_of_mumps", lambda *places: None)
    without = names(setup.kernels())
    output = capsys.readouterr().err
    assert "without its bridge to MUMPS" in output and "MUMPS_INCLUDE" in output
    monkeypatch.setattr(setup, "headers_of_mumps", lambda *places: Path("/there"))
    assert names(setup.kernels()) - without == {"microslip.linear._mumps"} and len(without) == 5
    assert capsys.readouterr().err == ""


def test_headers_are_searched_in_order(setup, tmp_path):
    stated, petsc, usual = tmp_path / "stated", tmp_path / "petsc" / "arch" / "include", tmp_path / "usual" / "include"
    for folder in (stated, petsc, usual):
        folder.mkdir(parents=True)
        (folder / "dmumps_c.h").touch()
    of_petsc, prefixes = {"PETSC_DIR": str(tmp_path / "petsc"), "PETSC_ARCH": "arch"}, (str(tmp_path / "usual"),)
    assert setup.headers_of_mumps({"MUMPS_INCLUDE": str(stated)} | of_petsc, prefixes) == stated
    assert setup.headers_of_mumps(of_petsc, prefixes) == petsc
    assert setup.headers_of_mumps({}, prefixes) == usual
    assert setup.headers_of_mumps({}, (str(tmp_path / "nothing"),)) is None
    assert (
        setup.headers_of_mumps({"MUMPS_INCLUDE": str(tmp_path)} | of_petsc, prefixes) is None
    )  # a stated path is not replaced by others
