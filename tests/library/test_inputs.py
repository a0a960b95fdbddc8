"""The input files of a scene: named files, their includes, related files; their sizes and hashes."""

import builtins
import hashlib
import os
from pathlib import Path

import pytest
from sources import ROOT

from microslip.formats.includes import included_files
from microslip.formats.read import read_model
from microslip.library.origin_of_run import fingerprint, input_files
from microslip.messages.errors import CaseError
from microslip.scene.read import read_scene

JOBS = ROOT / "jobs"
NODES = "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n3, 0, 1, 0\n4, 0, 0, 1\n"
ELEMENT = "*ELEMENT, TYPE=C3D4, ELSET=ALL\n1, 1, 2, 3, 4\n"


def _written(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    return folder / next(iter(files))


def _opened(path: Path, monkeypatch) -> set[Path]:
    """Return the files, other than the first, that its reader opens."""
    seen, plain_open = set(), builtins.open

    def watched(name, *args, **keys):
        if isinstance(name, str | os.PathLike) and Path(name).is_relative_to(path.parent):
            seen.add(Path(os.path.realpath(name)))
        return plain_open(name, *args, **keys)

    monkeypatch.setattr(builtins, "open", watched)
    read_model(path)
    monkeypatch.undo()
    return seen - {path}


def test_includes_of_abaqus_are_the_files_opened_by_its_reader(tmp_path, monkeypatch):
    path = _written(
        tmp_path,
        {
            "model.inp": '*Heading\n title, input=none.inc\n** *INCLUDE, INPUT=old.inc\n*include, input = "sub/nodes.inc"\n'
            "*ELEMENT, TYPE=C3D4,\nELSET=ALL, INPUT=elements.inc\n",
            "sub/nodes.inc": "*NODE, INPUT=table.inc\n",
            "sub/table.inc": NODES.partition("\n")[2],
            "elements.inc": "1, 1, 2, 3, 4",
            "old.inc": "",
            "none.inc": "",
        },
    )
    names = [str(each.relative_to(tmp_path)) for each in included_files(path)]
    assert names == ["sub/nodes.inc", "sub/table.inc", "elements.inc"]
    assert set(included_files(path)) == _opened(path, monkeypatch)


def test_includes_of_nastran_are_the_files_opened_by_its_reader(tmp_path, monkeypatch):
    pytest.importorskip("pyNastran")
    grids = "GRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nGRID,3,,0.,1.,0.\nGRID,4,,0.,0.,1.\n"
    cards = "CTETRA,1,1,1,2,3,4\nPSOLID,1,1\nMAT1,1,2.1+11,,.3,7800.\n"
    path = _written(
        tmp_path,
        {
            "model.bdf": "$ INCLUDE 'old.bdf'\nCEND\nBEGIN BULK\nINCLUDE 'grids.bdf'\n" + cards + "ENDDATA\n",
            "grids.bdf": grids,
            "old.bdf": "",
        },
    )
    assert [each.name for each in included_files(path)] == ["grids.bdf"]
    assert set(included_files(path)) == _opened(path, monkeypatch)


def test_includes_rejected_by_readers_are_no_input_and_no_endless_loop(tmp_path):
    _written(tmp_path, {"outside.inc": NODES})
    within = "*INCLUDE, INPUT=../../outside.inc\n*INCLUDE, INPUT=absent.inc\n*INCLUDE, INPUT=model.inp\n*INCLUDE, INPUT=\0\n"
    path = _written(tmp_path, {"folder/model.inp": within + "*INCLUDE, INPUT=again.inc\n", "folder/again.inc": within})
    assert [each.name for each in included_files(path)] == ["again.inc"]
    assert included_files(_written(tmp_path, {"mesh.msh": within})) == ()


@pytest.mark.parametrize("before", [0, 2**20 - 30, 2**20 - 12, 2**20, 2**20 + 5])
def test_includes_are_detected_at_the_end_of_any_block(tmp_path, before):
    lines = "1, 0.0, 0.0, 0.0\n" * (before // 17)
    path = _written(
        tmp_path, {"m.inp": "*NODE\n" + lines + "*INCLUDE, INPUT=nodes.inc", "nodes.inc": "", "nodes.in": "", "n": ""}
    )
    assert [each.name for each in included_files(path)] == ["nodes.inc"]


def test_inputs_of_a_scene_of_matrices_include_related_files():
    computed = dict(input_files(read_scene(JOBS / "calculix_blocks.toml")))
    names = {key: path.name for key, path in computed.items()}
    assert names["[model] stiffness"] == "calculix_blocks.sti" and names["beside calculix_blocks.sti"] == "calculix_blocks.dof"
    pairs = dict(input_files(read_scene(JOBS / "jenkins.toml")))
    assert any(key.endswith("pairs") and path.name == "jenkins_pairs.csv" for key, path in pairs.items())


def test_size_and_hash_are_those_of_the_bytes(tmp_path):
    content = bytes(range(256)) * 5000
    (tmp_path / "file").write_bytes(content)
    first, second = fingerprint([("a", tmp_path / "file"), ("b", tmp_path / "file")])
    assert (first.size, first.sha256) == (len(content), hashlib.sha256(content).hexdigest())
    assert (second.key, second.sha256) == ("b", first.sha256)
    (tmp_path / "file").write_bytes(content[:-1] + b"x")
    assert fingerprint([("a", tmp_path / "file")])[0].sha256 != first.sha256


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(CaseError, match="gone.csv: No such file"):
        fingerprint([("[model] dofs", tmp_path / "gone.csv")])
