"""The table of public models: files are read or rejected with a reason, edited lines are counted, modes are those of the commands."""

import gzip
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from plain_model import cdb, inp, plain

sys.path.append(str(Path(__file__).parents[2] / "jobs" / "real"))

import table
from table import checked, edited, fetched, files_of, frequencies, reason, reason_rows, solved


def test_files_are_read_or_rejected_with_a_reason(tmp_path):
    (tmp_path / "good.cdb").write_text(cdb(plain()))
    for name in ("bad1.inp", "bad2.inp"):
        (tmp_path / name).write_text(f"*NODE\n1,0.,0.,0.\n2,{name[3]},0.,0.\n*ELEMENT,TYPE=T3D2\n1,1,2\n")
    package = {"name": "two", "files": ["*.cdb", "bad*.inp"]}
    files = [checked(path) for path in files_of(package, tmp_path)]
    assert [result.outcome for result in files] == ["refused", "refused", "read"]
    ((name, why, example, n),) = reason_rows(package, files)
    assert (name, example, n) == ("two", "bad1.inp", "2") and "no volume elements (beams or shells)" in why


def test_a_defect_is_distinguished_from_a_rejection(tmp_path, monkeypatch):
    monkeypatch.setattr(table, "check_model", lambda *_: {}["missing"])
    (result,) = [checked(tmp_path / "any.inp")]
    assert (result.outcome, result.why) == ("stopped", "KeyError: 'missing'")


def test_equal_reasons_have_equal_texts():
    reasons = {
        reason(f"/a/m.inp: line {n}: it includes 'all{n}.msh', and there is no such file", Path("/a/m.inp")) for n in (1, 12)
    }
    assert reasons == {"line N: it includes a file, and there is no such file"}


def test_edited_lines_are_counted(tmp_path):
    scene = tmp_path / "s.toml"
    scene.write_text("#> a = 1\nb = 2\n")
    assert edited(scene, {"replace": [["#> a = 1", "a = 3"]], "add": "[c]\n\nd = 4\n"}) == 3
    assert scene.read_text().split() == ["a", "=", "3", "b", "=", "2", "[c]", "d", "=", "4"]
    with pytest.raises(ValueError, match="no line 'e'"):
        edited(scene, {"replace": [["e", "f"]]})


@pytest.mark.slow
def test_modes_are_those_of_the_two_commands(tmp_path):
    (tmp_path / "m.inp").write_text(inp(plain()))
    out, n, why = solved(tmp_path / "m.inp", {}, ["modes", "--count", str(table.N_MODES)], tmp_path)
    computed = frequencies(out, {}) if not why else None
    assert n == 0 and (why or (len(computed) == table.N_MODES and (np.diff(computed) >= 0.0).all()))


def test_compressed_inputs_and_built_models_are_written(tmp_path):
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "a.inp.gz").write_bytes(gzip.compress(inp(plain()).encode()))
    place = fetched({"fetch": ["apt", "set"]}, tmp_path)
    assert (place / "a.inp").read_text() == inp(plain())
    built = fetched({"fetch": ["built", "built"]}, tmp_path)
    assert checked(built / "fv52.inp").outcome == "read" and (built / "vm320_pairs.csv").exists()


def test_some_folders_of_a_repository_are_fetched(tmp_path, monkeypatch):
    """A local repository: the stated folders are fetched, the content of the others is not."""
    server = tmp_path / "server" / "owner" / "models"
    for name in ("beams/beam.inp", "videos/tour.bin"):
        (server / name).parent.mkdir(parents=True)
        (server / name).write_text(name)

    def git(command: str, folder: Path = server) -> str:
        return subprocess.run(["git", *command.split()], cwd=folder, check=True, capture_output=True, text=True).stdout

    for command in (
        "init -q",
        "config uploadpack.allowFilter true",
        "add .",
        "-c user.name=a -c user.email=a commit -q -m first",
    ):
        git(command)
    monkeypatch.setenv("GIT_CONFIG_COUNT", "1")
    monkeypatch.setenv("GIT_CONFIG_KEY_0", f"url.file://{tmp_path}/server/.insteadOf")
    monkeypatch.setenv("GIT_CONFIG_VALUE_0", "https://github.com/")
    place = fetched({"fetch": ["git", "owner/models", "beams"]}, tmp_path)
    assert (place / "beams" / "beam.inp").read_text() == "beams/beam.inp" and not (place / "videos").exists()
    missing = [word for word in git("rev-list --objects --missing=print HEAD", place).split() if word.startswith("?")]
    assert missing == ["?" + git("hash-object videos/tour.bin").strip()]
