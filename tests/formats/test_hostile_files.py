"""Hostile files: counts beyond the file, pipes and devices, cycles, bombs, links, code in the folder of a scene."""

import contextlib
import os
import pickle
import subprocess
import sys
import time
import zipfile
from pathlib import Path
from types import SimpleNamespace

import h5py
import matplotlib
import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from full_results import write_full_results
from plain_model import POISSON, YOUNG, bdf, exodus, inp, plain
from reader_seeds import SEEDS
from reader_targets import TARGETS, verdict
from scene_files import GOOD

from microslip.formats import hdf5, via_meshio
from microslip.formats import read as formats_read
from microslip.formats.includes import included_files
from microslip.formats.matrices import matlab
from microslip.formats.matrices import read as matrices_read
from microslip.formats.matrices.file_matrix import Wanted
from microslip.formats.matrices.read import read_any, read_matrix
from microslip.formats.nastran.read import read_by_pynastran
from microslip.formats.read import read_model
from microslip.messages.errors import CaseError, Interrupted, MeshError, MicroslipError, ResourceError
from microslip.results.read import read_in_sandbox, read_results
from microslip.results.scene_back import GONE, state_of_input
from microslip.results.style import RC
from microslip.scene.read import read_scene
from microslip.system import memory, sandbox

CASES = Path(__file__).parent / "fuzz_cases"
OTHERS = [name for name, target in TARGETS.items() if not target.is_own]
SOLVER = Path(__file__).parents[2] / "solver"
HUGE = "999999999999999999"


def read(folder, name, content):
    """Return the error message of the reader ``name`` for a file with this content."""
    target = TARGETS[name]
    path = folder / f"file{target.ending}"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    began = time.process_time()
    with pytest.raises(MicroslipError) as caught:
        target.read(path)
    assert time.process_time() - began < 5.0
    assert str(path) in str(caught.value) and len(str(caught.value)) < 1500
    return str(caught.value)


CUBE = "*NODE\n1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n5,0,0,1\n6,1,0,1\n7,1,1,1\n8,0,1,1\n*ELEMENT,TYPE=C3D8,ELSET=E\n1,1,2,3,4,5,6,7,8\n"
VTK = "# vtk DataFile Version 4.2\ntitle\nASCII\nDATASET UNSTRUCTURED_GRID\n"


@pytest.mark.parametrize(
    "name, content, message",
    [
        ("msh", f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{HUGE}\n1 0 0 0\n$EndNodes\n", "holds 4 numbers"),
        ("msh", f"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n{HUGE} 1 1 1\n$EndNodes\n", "ends early"),
        ("abaqus", CUBE.replace("8,0,1,1\n", f"{HUGE}0,0,1,1\n"), ""),
        ("abaqus", CUBE + f"*NSET, NSET=N, GENERATE\n1, 1e300, 1\n*BOUNDARY\nN, 1, {HUGE}\n", ""),
        ("abaqus", f'*NODE, NSET={"," * 200_000}"\n1,0,0,0\n', ""),
        ("ansys", f"NBLOCK,6,SOLID,1,{HUGE}\n(3i9,6e21.13e3)\n        1\nEBLOCK,19,SOLID,1,1\n(19i9)\n", "more than a file of"),
        ("nastran", "GRID,1,,0.,0.,0.\nCTETRA,1,1,1,1,1,1\nSPC1,5,123,1,THRU,999999999999\n", "1 THRU 999999999999 requests"),
        ("nastran", f"GRID,1,,0.,0.,0.\nSPC1    5       123     1       THRU    {10**8 - 1}\n", "end the range at the last"),
        ("nastran", "\n" * 100_000, "empty"),
        ("unv", f"    -1\n  2412\n         1       115         1         1         7{HUGE}\n         1\n    -1\n", ""),
        ("vtk", VTK + f"POINTS {HUGE} double\n0 0 0\n", ""),
        ("vtk", VTK + f"POINTS 1 double\n0 0 0\nCELLS 1 2\n1 0\nCELL_TYPES {HUGE}\n1\n", ""),
        ("vtk", (CASES / "vtk-cells_of_90_gigabytes").read_bytes(), "limit of a file of"),
        ("vtu", '<?xml version="1.0"?><VTKFile type="UnstructuredGrid"><UnstructuredGrid><Piece NumberOfPoints="9', ""),
        ("mtx", f"%%MatrixMarket matrix coordinate real general\n{HUGE} {HUGE} 1\n1 1 1\n", "header states"),
        ("mtx", "1e300,1, 1,1, 1.0\n", "whole numbers"),
        ("calculix", "1e300 1 2.0\n", "header states"),
        ("dmig", f"DMIG,K,0,6,2,0\nDMIG*,K,{HUGE},1\n*,{HUGE},1,1.0\n", ""),
        ("harwell_boeing", f"t\n1 1 {HUGE} 1 0\nRUA {HUGE:>20} {HUGE} {HUGE}\n(1I8) (1I8) (1E20.12)\n", ""),
        ("pairs", "x1,y1,z1,x2,y2,z2,mu,n0,g0,kt,kn\n1e300,1,2,3,4,5,0.3,1,0,1,1\n", "is not a DOF number"),
        ("dofs", "node,direction\n1e300,1\n", "a node number and a direction"),
        ("nodes", "node,x,y,z\n1e300,0,0,0\n", "whole and above 0"),
        ("nodes", "node,x,y,z\n1,0,0,nan\n", "not a finite number"),
        ("forces", "node,fx,fy,fz\n1e300,1,0,0\n", "no element of a body has a node"),
        ("parameters", f"node,friction\n{'1' * 200_000},0.3\n", ""),
        ("scene", "a = " + "[" * 100_000, ""),
        ("scene", ".".join("a" * 50_000) + " = 1", ""),
        ("scene", f"title = {'9' * 6000}", ""),
        ("scene", f"{'a' * 100_000} = 1\n", "mistakes"),
    ],
)
def test_counts_and_numbers_beyond_the_file_are_refused(tmp_path, name, content, message):
    assert message in read(tmp_path, name, content)


@pytest.mark.parametrize(
    "name, old, new, message",
    [
        ("ansys", "SOLID,6,6", "SOLID,9,9", "EBLOCK counts 9 elements and holds 6"),
        ("ansys", "SOLID,6,6", "SOLID,3,3", "holds 6 lines, and 3 make the 3 elements that it counts"),
        ("ansys", "1132,32", "1132,40", "NBLOCK counts 40 nodes and holds 32"),
        ("ansys", "1132,32", "1132,31", "NBLOCK counts 31 nodes and holds 32"),
        ("ansys", "NODE,       8\n", "NODE,       9\n", "CMBLOCK BAR_BOTTOM counts 9 numbers and holds 8"),
        ("ansys", "       -1\nCMBLOCK", "CMBLOCK", "EBLOCK ends without -1"),
        ("ansys_input", "eblock,19,solid,,3", "eblock,19,solid,,4", "EBLOCK counts 4 elements and holds 3"),
        ("abaqus", "*End Assembly\n", "", "*ASSEMBLY has no *END ASSEMBLY"),
        ("abaqus", "*End Step\n", "*Step\n*End Step\n", "*STEP within another"),
        ("abaqus", "\n2, ", "\n2\n2, ", "every line must hold a number and coordinates"),
        ("calculix", "\n", "", "does not end; the file is truncated"),
        ("dmig", "\n", "", "does not end; the file is truncated"),
    ],
)
def test_counts_and_blocks_of_a_file_must_be_complete(tmp_path, name, old, new, message):
    text = min((seed.decode() for seed in SEEDS[name](tmp_path)[:2]), key=len)
    at = text.rfind(old) if message.startswith("does not end") else text.find(old)
    assert at >= 0
    assert message in read(tmp_path, name, text[:at] + new + text[at + len(old) :])


@pytest.mark.parametrize("kind, n_lines", [("hex8", 1), ("hex20", 2)])
def test_an_element_with_a_missing_node_is_refused(tmp_path, kind, n_lines):
    lines, n = inp(plain(kind)).splitlines(), int(kind[3:])
    last = next(i for i, line in enumerate(lines) if line.startswith("*Element")) + n_lines
    lines[last] = lines[last].rpartition(",")[0]
    assert f"element 1 has {n - 1} nodes, and {n} are expected" in read(tmp_path, "abaqus", "\n".join(lines))


@pytest.mark.parametrize(
    "name, write, last", [("fem", bdf, "ENDDATA"), ("nastran", bdf, "ENDDATA"), ("abaqus", inp, "*End Step")]
)
def test_missing_end_cards_are_reported(tmp_path, name, write, last):
    path = tmp_path / f"m{TARGETS[name].ending}"
    for text, n in ((write(plain()), 0), (write(plain()).replace(last, ""), 1)):
        path.write_text(text)
        assert [finding.word for finding in read_model(path).findings].count(last.upper()) == n


@pytest.mark.parametrize("second, changes", [("1., 0.3", True), (f"{YOUNG}, {POISSON}", False)])
def test_a_repeated_property_is_reported(tmp_path, second, changes):
    (tmp_path / "m.inp").write_text(inp(plain()).replace("*Elastic\n", f"*Elastic\n{second}\n*Elastic\n"))
    (finding,) = (finding for finding in read_model(tmp_path / "m.inp").findings if finding.word == "*ELASTIC")
    assert finding.changes == changes and "of material 'Steel' again, after line" in finding.effect


@pytest.mark.parametrize("second, changes", [("1., 0.3", True), (f"{YOUNG}, {POISSON}", False)])
def test_the_first_definition_of_a_repeated_material_holds(tmp_path, second, changes):
    text = inp(plain())
    cards = text[text.index("*Material") :].partition("*Solid")[0].partition("*Step")[0]
    second_cards = cards.replace("Steel", "STEEL").replace(f"{YOUNG}, {POISSON}", second)
    (tmp_path / "m.inp").write_text(text.replace(cards, cards + second_cards))
    model = read_model(tmp_path / "m.inp")
    (finding,) = (finding for finding in model.findings if finding.word == "*MATERIAL")
    assert finding.changes == changes and "as first stated" in finding.effect
    assert model.materials["Steel"].young == YOUNG and list(model.materials) == ["Steel"]


def test_cards_of_optistruct_are_read_or_reported(tmp_path):
    """Commands before the bulk data are those of OptiStruct; of two sets of supports the selected one holds."""
    head, _, bulk = bdf(plain(), ("CBUSH,77,7,101,102", "SPC1,2,1,102")).partition("BEGIN BULK")
    sets = head[head.index("SET 1") :]
    case_control = (
        "SCREEN OUT\nDISPLACEMENT(H3D) = ALL\n$HMNAME LOADSTEP 1\nSUBCASE 1\n  LABEL x\n  ANALYSIS MODES\n  SPC =    1\n"
    )
    (tmp_path / "m.fem").write_text(f"{sets}{case_control}BEGIN BULK{bulk}")
    model = read_model(tmp_path / "m.fem")
    assert [support.fix for support in model.supports] == [("x", "y", "z")] and len(model.groups["SET 2"].nodes) == 8
    assert [finding.word for finding in model.findings if finding.changes] == ["CBUSH"]


def test_cells_that_meshio_omits_are_refused(tmp_path):
    points = "POINTS 4 double\n0 0 0 1 0 0 0 1 0 0 0 1\n"
    message = read(
        tmp_path,
        "vtk",
        VTK.replace("4.2", "5.1")
        + points
        + "CELLS 3 8\nOFFSETS vtktypeint64\n0 4 8\nCONNECTIVITY vtktypeint64\n0 1 2 3 0 1 2 3\nCELL_TYPES 2\n10\n41\n",
    )
    assert "VTK's type 41" in message


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
@pytest.mark.parametrize("content", [b"", b"\n", b"\0" * 300, b"\xff\xfe" * 200, b"-1 " * 300])
def test_meaningless_files_are_refused(tmp_path, name, content):
    read(tmp_path, name, content)


# -- not a regular file-------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", OTHERS)
@pytest.mark.parametrize("sort", ["pipe", "device"])
def test_pipes_and_devices_are_not_opened(tmp_path, name, sort):
    path = tmp_path / f"input{TARGETS[name].ending}"
    if sort == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to("/dev/zero")
    with pytest.raises(MicroslipError, match="pipe or a device|no file|no such file"):
        TARGETS[name].read(path)


def test_a_pipe_as_the_mesh_of_a_scene_is_refused(tmp_path):
    os.mkfifo(tmp_path / "fan_sector.msh")
    (tmp_path / "s.toml").write_text(GOOD)
    with pytest.raises(CaseError, match='mesh = "fan_sector.msh": that is a pipe or a device; a file is expected'):
        read_scene(tmp_path / "s.toml")


@pytest.mark.parametrize("line", ["*INCLUDE, INPUT=pipe", "*INCLUDE, INPUT=/dev/zero", "*INCLUDE, INPUT=."])
def test_an_include_must_be_a_regular_file_of_the_folder(tmp_path, line):
    os.mkfifo(tmp_path / "pipe")
    read(tmp_path, "abaqus", f"{line}\n{CUBE}")
    read(tmp_path, "nastran", f"INCLUDE '{line.partition('=')[2]}'\n" + bdf(plain()))


@pytest.mark.slow
@pytest.mark.parametrize("name, line", [("abaqus", "*INCLUDE, INPUT={}\n"), ("nastran", "INCLUDE '{}'\n")])
def test_repeated_includes_are_bounded(tmp_path, name, line):
    """A file of 10 kB included 2^20 times would be ten gigabytes."""
    for i in range(20):
        (tmp_path / f"f{i}").write_text(2 * line.format(f"f{i + 1}"))
    (tmp_path / "f20").write_text(100 * f"** {100 * 'x'}\n" if name == "abaqus" else 100 * f"$ {60 * 'x'}\n")
    assert "included" in read(tmp_path, name, line.format("f0"))


@pytest.mark.parametrize("name, line", [("abaqus", "*INCLUDE, INPUT={}\n"), ("nastran", "INCLUDE '{}'\n")])
def test_a_thousand_nested_includes_are_refused(tmp_path, name, line):
    for i in range(1200):
        (tmp_path / f"f{i}").write_text(line.format(f"f{i + 1}"))
    (tmp_path / "f1200").write_text("")
    assert "includ" in read(tmp_path, name, line.format("f0"))
    assert 50 < len(included_files(tmp_path / f"file{TARGETS[name].ending}")) < 1200


def test_included_bulk_data_is_read_in_place(tmp_path):
    lines = bdf(plain("hex8")).splitlines(keepends=True)
    at = next(i for i, line in enumerate(lines) if line.startswith("GRID"))
    (tmp_path / "grid.inc").write_text("".join(lines[at : at + 5]))
    (tmp_path / "whole.bdf").write_text("".join(lines))
    (tmp_path / "parts.bdf").write_text("".join([*lines[:at], "INCLUDE 'grid.inc'\n", *lines[at + 5 :]]))
    expected, parts = read_model(tmp_path / "whole.bdf"), read_model(tmp_path / "parts.bdf")
    np.testing.assert_array_equal(parts.numbers, expected.numbers)
    np.testing.assert_array_equal(parts.points, expected.points)


# -- archives and HDF5 --------------------------------------------------------------------------------------------------


class Payload:
    """An object whose unpickling runs a command."""

    def __reduce__(self):
        return os.system, ("touch executed",)


def test_objects_of_archives_are_not_unpickled(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.savez(tmp_path / "file.npz", K=np.array([[Payload()]], dtype=object))
    with pytest.raises(CaseError, match="cannot be read as a matrix"):
        read_matrix(tmp_path / "file.npz", "[model] stiffness", "K")
    with zipfile.ZipFile(tmp_path / "raw.npz", "w") as archive:
        archive.writestr("K.npy", pickle.dumps(Payload()))
    with pytest.raises(CaseError, match="cannot be read as a matrix"):
        read_matrix(tmp_path / "raw.npz", "[model] stiffness", "K")
    assert not (tmp_path / "executed").exists()


def test_an_archive_that_unpacks_to_gigabytes_is_refused(tmp_path):
    head = b"{'descr': '<f8', 'fortran_order': False, 'shape': (20000, 20000), }".ljust(117) + b"\n"
    with zipfile.ZipFile(tmp_path / "K.npz", "w", zipfile.ZIP_BZIP2) as archive:
        archive.writestr("K.npy", b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + bytes(10**7))
    assert (tmp_path / "K.npz").stat().st_size < 2000
    with pytest.raises(CaseError, match="claims 10000128 bytes in a file of"):
        read_matrix(tmp_path / "K.npz", "[model] stiffness", "K")


def test_entities_of_xml_are_not_expanded(tmp_path):
    bomb = "".join(f'<!ENTITY a{i} "{10 * f"&a{i - 1};"}">' for i in range(1, 10))
    read(tmp_path, "vtu", f'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a0 "0 0 0 0 0 0">{bomb}]><VTKFile>&a9;</VTKFile>')
    (tmp_path / "secret").write_text("7")
    read(
        tmp_path,
        "vtu",
        f'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY s SYSTEM "file://{tmp_path}/secret">]><VTKFile>&s;</VTKFile>',
    )


def replaced(path, name, make):
    with h5py.File(path, "r+") as file:
        values = file[name][()]
        del file[name]
        make(file, values)
    return path


def _alias(file, values):
    file["joint/mu"] = file["joint/area"]


def _wide_chunk(file, values):
    file.create_dataset("joint/mu", values.shape, "f8", chunks=(2**27,), maxshape=(None,))


def _foreign_filter(file, values):
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_chunk((len(values),))
    plist.set_filter(32015, h5py.h5z.FLAG_OPTIONAL, (3,))
    space = h5py.h5s.create_simple(values.shape)
    h5py.h5d.create(file.id, b"joint/mu", h5py.h5t.IEEE_F64LE, space, plist)


def _references(file, values):
    file.create_dataset("joint/mu", data=np.array([file.ref] * len(values), dtype=h5py.ref_dtype), dtype=h5py.ref_dtype)


@pytest.mark.parametrize(
    "make, message",
    [
        (_alias, "are one data set under two names"),
        (_wide_chunk, "chunks of 1073741824 bytes"),
        (_foreign_filter, "a filter, number 32015"),
        (_references, "variable length or references"),
    ],
)
def test_results_that_expand_or_need_plugins_are_refused(tmp_path, make, message):
    path = replaced(write_full_results(tmp_path), "joint/mu", make)
    with pytest.raises(CaseError, match=message):
        read_results(path)
    with pytest.raises(CaseError, match=message):
        raise CaseError(_message_of_convert(path, tmp_path))


def _message_of_convert(path, folder):
    from microslip.results.convert import convert

    try:
        convert(path, folder / "out", ("mat",))
    except CaseError as problem:
        return str(problem)
    return "converted"


@pytest.mark.parametrize("place", ["pipe", "/dev/zero", ".", "none\0"])
def test_a_stated_source_of_results_may_be_a_pipe(tmp_path, place):
    os.mkfifo(tmp_path / "pipe")
    assert state_of_input(SimpleNamespace(path=os.path.join(tmp_path, place), size=0, sha256="")) == GONE


def test_texts_of_variable_length_are_read(tmp_path):
    path = write_full_results(tmp_path)
    with h5py.File(path, "r+") as file:
        del file["scene/name"]
        file["scene/name"] = "earlier"
    read_in_sandbox(path)
    assert read_results(path).name == "earlier"


def test_exodus_in_hdf5_claims_no_more_than_it_holds(tmp_path):
    exodus(plain("tet4"), tmp_path / "file.e", True)
    with h5py.File(tmp_path / "file.e", "r+") as file:
        del file["coordx"]
        file.create_dataset("coordx", (10**8,), "f8", chunks=(100,))
    with pytest.raises(MeshError, match="coordx claims 800000000 bytes and holds 0"):
        read_model(tmp_path / "file.e")


# -- memory -----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_memory_is_bounded_only_while_a_file_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(formats_read, "_FREE", 2**27)
    (tmp_path / "f").write_bytes(b"x")
    with pytest.raises(MeshError, match="limit of a file of 1 bytes"):
        with formats_read.bounded_memory(str(tmp_path / "f")):
            np.ones(2**26)
    assert len(np.ones(2**26)) == 2**26


# -- nothing in the folder of a scene is executed -----------------------------------------------------------------------


@pytest.mark.slow
def test_modules_in_the_folder_are_not_imported(tmp_path):
    """The modules have names that the program imports."""
    for name in ("numpy", "h5py", "pydantic", "tomllib", "signal", "json", "matplotlib", "petsc4py", "scipy"):
        (tmp_path / f"{name}.py").write_text("open('executed', 'w').close()\n")
    (tmp_path / "s.toml").write_text("title = 1\n")
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("OMPI_", "PMI"))}
    environment |= {"PYTHONPATH": str(SOLVER), "MPLCONFIGDIR": str(tmp_path / "cache")}
    for command in (["check", "s.toml"], ["plot", "none.h5"]):
        process = subprocess.run(
            [sys.executable, "-m", "microslip", *command],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert process.returncode == 2, process.stderr
    assert not (tmp_path / "executed").exists()


def test_options_of_petsc_in_the_folder_are_ignored(tmp_path):
    """.petscrc and petscrc of the folder, .petscrc of the home folder; PETSc has only the options of the command."""
    for name in (".petscrc", "petscrc"):
        (tmp_path / name).write_text("-from_a_file 1\n")
    program = (
        "from microslip.parallel.petsc import initialise\n"
        "PETSc, _ = initialise(['-hb_snes_max_it', '7'])\n"
        "print(sorted(PETSc.Options().getAll()))\n"
    )
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("OMPI_", "PMI", "PETSC_OPTIONS"))}
    environment |= {"PYTHONPATH": str(SOLVER), "HOME": str(tmp_path)}
    process = subprocess.run(
        [sys.executable, "-P", "-c", program], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120
    )
    assert "hb_snes_max_it" in process.stdout and "from_a_file" not in process.stdout, process.stderr


def test_pictures_ignore_a_matplotlibrc():
    with matplotlib.rc_context({"text.usetex": True, "text.latex.preamble": r"\input{secret}", "font.size": 40.0}):
        with matplotlib.rc_context(RC):
            assert not matplotlib.rcParams["text.usetex"] and not matplotlib.rcParams["text.latex.preamble"]
            assert matplotlib.rcParams["font.size"] == RC["font.size"]


def test_names_of_a_file_do_not_control_the_terminal(capsys):
    from microslip.guards.ending import _write_error

    _write_error("group \x1b]0;owned\x07 'blade' \u202e\n  second line")
    message = capsys.readouterr().err
    assert "\x1b" not in message and "\x07" not in message and message.endswith("\n  second line\n") and "'blade'" in message


def test_the_oracle_of_the_fuzzers_detects_a_fault(tmp_path):
    """An oracle that cannot fail proves nothing."""
    from reader_targets import Target

    def gives_up(path):
        raise KeyError("x")

    assert verdict(Target(".x", gives_up), tmp_path / "f").startswith("KeyError in")
    assert verdict(Target(".x", lambda path: None), tmp_path / "f") is None
    assert inp(plain()).startswith("*Heading")


def test_values_beyond_the_available_memory_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "memory_left_here", lambda: 1e8)
    with h5py.File(tmp_path / "file.h5", "w") as file:
        for name in ("first", "second", "third"):
            file.create_dataset(name, data=np.zeros(2_500_000), compression="gzip", chunks=(250_000,))
        storage = hdf5.Storage(10**6)
        assert storage.fault(file["first"], "first") is storage.fault(file["second"], "second") is None
        assert (
            storage.fault(file["third"], "third")
            == "third and what was read before it need 120 MB of memory, of which 100 MB are left"
        )


def test_a_packed_matrix_beyond_the_available_memory_is_refused_before_unpacking(tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "memory_left_here", lambda: 5e7)
    big, other = np.zeros((2000, 2000)), np.zeros((3, 3))
    np.savez_compressed(tmp_path / "K.npz", K=big, other=other)
    scipy.io.savemat(tmp_path / "K.mat", {"K": big, "other": other}, do_compression=True)
    sp.save_npz(tmp_path / "S.npz", sp.csr_matrix(([0.0] * 2_500_000, [0] * 2_500_000, [0, 2_500_000, 2_500_000]), (2, 2)))
    for name, needed in (("K.npz", "64 MB"), ("S.npz", "60 MB")):
        with pytest.raises(ResourceError, match=f"{name}: key: its numbers need {needed} of memory, of which 50 MB are left"):
            read_any(tmp_path / name, "key", "K")
    with pytest.raises(ResourceError, match="its variable K needs 64 MB of memory, of which 50 MB are left"):
        matlab._read(Wanted(tmp_path / "K.mat", "K", "K.mat"))
    assert read_any(tmp_path / "K.npz", "key", "K", "other").matrix.shape == (3, 3)
    np.savez_compressed(tmp_path / "rows.npz", format=b"csr", shape=np.array([10**9, 10**9]), data=np.zeros(1000))
    with pytest.raises(CaseError, match="its header states 1000000000 rows"):
        read_any(tmp_path / "rows.npz", "key", "K")


def test_no_reader_gets_more_than_the_available_memory(tmp_path, monkeypatch):
    limits = []
    monkeypatch.setattr(memory, "memory_left_here", lambda: 5e8)
    monkeypatch.setattr(sandbox, "call", lambda *arguments, memory, **others: limits.append(memory))
    (tmp_path / "f").write_bytes(bytes(10**6))
    sandbox.read_file(tmp_path / "f", len, gain=2000)
    monkeypatch.setattr(formats_read, "_address_space", lambda more: limits.append(more) or contextlib.nullcontext())
    with formats_read.bounded_memory(str(tmp_path / "f")):
        pass
    monkeypatch.setattr(memory, "memory_left_here", lambda: 1.0)  # libraries map more than they use
    sandbox.read_file(tmp_path / "f", len, gain=0)
    assert limits == [5e8, 5e8, 2**28]


def test_a_signal_during_a_read_is_not_reported_as_a_fault_of_the_file(tmp_path, monkeypatch):
    def interrupted(*_):
        raise Interrupted("stopped by SIGTERM")

    monkeypatch.setitem(matrices_read.READERS, ".mtx", interrupted)
    monkeypatch.setattr(via_meshio, "load_meshio", interrupted)
    (tmp_path / "K.mtx").touch()
    with pytest.raises(Interrupted):
        read_matrix(tmp_path / "K.mtx", "[model] stiffness", "K")
    with pytest.raises(Interrupted):
        via_meshio._read_quietly("model.vtk", "vtk")
    with pytest.raises(Interrupted), read_by_pynastran("a bulk data file"):
        interrupted()
