"""setup.py: the bridge to MUMPS is built where MUMPS' headers are, and left out where they are not."""

import importlib.util
from pathlib import Path

import pytest

pytestmark = pytest.mark.ranks(1)
SETUP = Path(__file__).parents[2] / "setup.py"


@pytest.fixture
def setup(monkeypatch):
    """setup.py as a module: nothing is built."""
    pytest.importorskip("Cython")
    spec = importlib.util.spec_from_file_location("microslip_setup", SETUP)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def names(extensions):
    return {extension.name for extension in extensions}


def test_without_headers_the_bridge_alone_is_left_out(setup, monkeypatch, capsys):
    monkeypatch.setattr(setup, "headers_of_mumps", lambda *places: None)
    without = names(setup.kernels())
    said = capsys.readouterr().err
    assert "without its bridge to MUMPS" in said and "MUMPS_INCLUDE" in said
    monkeypatch.setattr(setup, "headers_of_mumps", lambda *places: Path("/there"))
    assert names(setup.kernels()) - without == {"microslip.linear._mumps"} and len(without) == 5
    assert capsys.readouterr().err == ""


def test_where_headers_are_looked_for(setup, tmp_path):
    stated, petsc, usual = tmp_path / "stated", tmp_path / "petsc" / "arch" / "include", tmp_path / "usual" / "include"
    for folder in (stated, petsc, usual):
        folder.mkdir(parents=True)
        (folder / "dmumps_c.h").touch()
    of_petsc, prefixes = {"PETSC_DIR": str(tmp_path / "petsc"), "PETSC_ARCH": "arch"}, (str(tmp_path / "usual"),)
    assert setup.headers_of_mumps({"MUMPS_INCLUDE": str(stated)} | of_petsc, prefixes) == stated
    assert setup.headers_of_mumps(of_petsc, prefixes) == petsc
    assert setup.headers_of_mumps({}, prefixes) == usual
    assert setup.headers_of_mumps({}, (str(tmp_path / "nothing"),)) is None
    assert setup.headers_of_mumps({"MUMPS_INCLUDE": str(tmp_path)} | of_petsc, prefixes) is None  # what is stated, or none
