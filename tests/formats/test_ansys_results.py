"""Results files of Ansys: the model as the library returns it, findings, missing and damaged files."""

import struct
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from in_process import in_process

from microslip.formats.read import read_model
from microslip.messages.errors import MeshError
from microslip.tables.structure import Body, Material, Support

HEAD = [1, 1, 1, 1, 0, 0, 0, 0, 7, 0]  # of element 7: material, type, real constants, ...
CUBE = np.array([(x, y, z) for z in (0.0, 1.0) for x, y in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))])


class Result:
    """The part of a result of ansys.mapdl.reader that the program reads."""

    def __init__(self, element=185, keys=(0, 2)):
        self.mesh = SimpleNamespace(
            nnum=np.arange(11, 19),
            nodes=CUBE,
            node_angles=None,
            n_elem=1,
            enum=np.array([7]),
            _elem=np.array([*HEAD, *range(11, 19)]),
            _elem_off=np.array([0, 18]),
            ekey=np.array([[1, element]]),
            key_option={},
            rlblock=[],
            rlblock_num=[],
            node_components={"ROOT": np.array([11, 12, 13, 14])},
            element_components={"ALL": np.array([7])},
        )
        self._element_table = {"keyopts": {1: np.array([*keys, *[0] * (11 - len(keys))])}}
        self.materials = {1: {"EX": 2e11, "NUXY": 0.3, "DENS": 7800.0, "ALPX": 1e-5}}

    def nodal_boundary_conditions(self, number):
        return np.array([11, 11, 11, 12]), np.array([1, 2, 3, 3]), np.zeros(4)

    def result_dof(self, number):
        return ["UX", "UY", "UZ"]


def install(monkeypatch, read):
    in_process(monkeypatch)
    for name in ("ansys", "ansys.mapdl", "ansys.mapdl.reader"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setattr(sys.modules["ansys.mapdl.reader"], "read_binary", read, raising=False)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "job.rst"
    path.write_bytes(b"\0" * 400)
    return path


def test_the_model_of_a_results_file_is_read(monkeypatch, file):
    install(monkeypatch, lambda path, parse_vtk: Result())
    model = read_model(file)
    assert model.cells[0].kind == "hex8" and model.cells[0].numbers.tolist() == [7]
    assert model.materials == {"material 1": Material.of_file(young=2e11, poisson=0.3, density=7800.0, expansion=1e-5)}
    assert model.bodies == {"material 1": Body.of_file(group="material 1", material="material 1", integration="full")}
    assert model.numbers[model.groups["ROOT"].nodes].tolist() == [11, 12, 13, 14] and "ALL" in model.groups
    assert Support.of_file(group="D xyz", fix=("x", "y", "z")) in model.supports
    assert not [finding for finding in model.findings if finding.changes]
    assert "has no equations, couplings" in model.facts[-1]


def test_entries_that_change_the_answer_are_findings(monkeypatch, file):
    def read(path, parse_vtk):
        result = Result(element=181)
        result.materials[1]["EY"] = 1e11
        result.materials[1]["stress_failure_criteria"] = np.zeros((2, 3))
        result.nodal_boundary_conditions = lambda number: (np.array([11]), np.array([1]), np.array([0.5]))
        return result

    install(monkeypatch, read)
    words = {finding.word for finding in read_model(file).findings if finding.changes}
    assert {"element type 181", "MP", "D"} <= words


def broken(path, parse_vtk):
    raise struct.error("required argument is not an integer")


WRONG = {
    "damaged": (broken, "truncated, damaged, or holds no results"),
    "full": (lambda path, parse_vtk: object(), "it holds no mesh"),
}


@pytest.mark.parametrize("read, message", WRONG.values(), ids=WRONG)
def test_damaged_files_and_files_without_mesh_are_refused(monkeypatch, file, read, message):
    install(monkeypatch, read)
    with pytest.raises(MeshError, match=message):
        read_model(file)


def test_without_the_library_the_message_names_the_package_to_install(monkeypatch, file):
    in_process(monkeypatch)
    monkeypatch.setitem(sys.modules, "ansys.mapdl.reader", None)
    with pytest.raises(MeshError, match="pip install ansys-mapdl-reader .* or write the archive: CDWRITE"):
        read_model(file)


def test_the_example_of_the_library_is_read():
    """The file holds modes of the structure, whose matrices are in tests/elements."""
    examples = pytest.importorskip("ansys.mapdl.reader.examples")
    model = read_model(examples.rstfile)
    assert [(cells.kind, len(cells.nodes)) for cells in model.cells] == [("hex20", 40)] and len(model.points) == 321
    assert model.materials["material 1"].young == pytest.approx(16.9e6)
