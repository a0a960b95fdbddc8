"""The origin of results: stored with them, shown, and restored as a scene that reads the same files."""

import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from synthetic_results import branch, head, no_pairs, two_flanks, write

import microslip
from microslip.library.origin_of_run import fingerprint
from microslip.messages.errors import CaseError
from microslip.results.convert import convert
from microslip.results.origin import InputFile, Origin
from microslip.results.read import read_results
from microslip.results.record import ResultFile
from microslip.results.report.tables import origin_table
from microslip.results.writer import ResultWriter
from microslip.system.versions import _PACKAGE, commit, program_hash

SCENE = """# of the wing
title = "../meshes/wing.msh, twice"   # a title like a path
[model]
mesh = "../meshes/wing.msh"  # in mm
[[joints]]
name = "lap"
parameters = '../meshes/values.csv'
"""


@pytest.fixture
def stored_results(tmp_path) -> ResultFile:
    """Return results of a scene in jobs/ that reads two files in meshes/, in results/."""
    for folder in ("jobs", "meshes", "results"):
        (tmp_path / folder).mkdir()
    (tmp_path / "meshes" / "wing.msh").write_text("a mesh")
    (tmp_path / "meshes" / "values.csv").write_text("1, 2")
    files = [("[model] mesh", tmp_path / "jobs" / "../meshes/wing.msh"), ("values", tmp_path / "jobs" / "../meshes/values.csv")]
    origin = Origin(
        command="microslip run wing.toml --set 'title=\"<b>\"'",
        started="2026-11-22 18:00:00 +0000",
        scene_path=str(tmp_path / "jobs" / "wing.toml"),
        settings=('title="<b>"',),
        hosts=("one", "one", "two"),
        n_groups=2,
        environment={"OMP_NUM_THREADS": "1"},
        inputs=fingerprint(files),
    )
    first = replace(head(no_pairs()), name="wing", scene_text=SCENE, origin=origin, n_dof=9693)
    from mpi4py import MPI

    ResultWriter(MPI.COMM_SELF, str(tmp_path / "results"), first, 7).close()
    return read_results(str(tmp_path / "results" / "results.h5"))


def test_the_origin_is_stored_and_read(stored_results, tmp_path):
    assert stored_results.n_dof == 9693 and stored_results.origin is not None
    assert stored_results.origin.n_ranks == 3 and stored_results.origin.settings == ('title="<b>"',)
    assert stored_results.origin.inputs[0].size == 6 and stored_results.origin.inputs[1].key == "values"
    assert stored_results.origin.environment == {"OMP_NUM_THREADS": "1"}


def test_older_files_have_no_origin(tmp_path):
    results = read_results(write(tmp_path, [branch(1.0, two_flanks(4, 1), n_points=3)], two_flanks(4, 1)))
    assert results.origin is None and results.n_dof == 0 and origin_table(results) == ""


def test_the_report_shows_hashes_and_escapes(stored_results):
    html = origin_table(stored_results)
    assert (
        stored_results.origin.inputs[0].sha256 in html
        and "&lt;b&gt;" in html
        and "<b>" not in html
        and "3 in 2 groups, on one, two" in html
    )


def test_the_restored_scene_has_its_comments_and_files(stored_results, tmp_path):
    (path,) = convert(stored_results.path, tmp_path / "elsewhere" / "deep", ["scene"])
    text = path.read_text()
    tables = tomllib.loads(text)
    assert path.name == "wing.toml" and "# of the wing" in text and "# in mm" in text
    for stated, name in ((tables["model"]["mesh"], "wing.msh"), (tables["joints"][0]["parameters"], "values.csv")):
        assert (path.parent / stated).resolve() == (tmp_path / "meshes" / name).resolve()
    assert tables["title"] == "../meshes/wing.msh, twice"
    assert "3 ranks in 2 groups: microslip run wing.toml" in text and "PETSc options: -- -hb_snes_max_it 30" in text
    assert convert(stored_results.path, path.parent, ["scene"]) == [path]  # the same once more is no conflict


def test_changed_input_files_are_reported(stored_results, tmp_path):
    (tmp_path / "meshes" / "wing.msh").write_text("b mesh")
    (tmp_path / "meshes" / "values.csv").unlink()
    (path,) = convert(stored_results.path, tmp_path / "again", ["scene"])
    mesh, values = (next(line for line in path.read_text().splitlines() if key in line) for key in ("[model] mesh", "# values"))
    assert mesh.endswith("changed since") and values.endswith("missing")


def test_a_scene_of_the_user_is_not_overwritten(stored_results, tmp_path):
    (tmp_path / "results" / "wing.toml").write_text("mine")
    with pytest.raises(CaseError, match="there is a file of this name already"):
        convert(stored_results.path, tmp_path / "results", ["scene"])
    assert (tmp_path / "results" / "wing.toml").read_text() == "mine"


@pytest.mark.parametrize("text", ["no = [toml", 'x = """\n../meshes/wing.msh"""\nmesh = "../meshes/wing.msh"\n'])
def test_a_text_that_cannot_be_changed_is_restored_unchanged(stored_results, tmp_path, text):
    from microslip.results.scene_back import relocated

    assert relocated(replace(stored_results, scene_text=text), tmp_path) == text


def test_the_name_of_a_matrix_in_a_file_is_preserved(stored_results, tmp_path):
    from microslip.results.scene_back import relocated

    path = str(tmp_path / "jobs" / "k.mat")
    origin = replace(stored_results.origin, inputs=(InputFile("[model] stiffness", path, 1, ""),))
    changed = relocated(replace(stored_results, origin=origin, scene_text='[model]\nstiffness = "k.mat:K"\n'), tmp_path)
    assert changed == '[model]\nstiffness = "jobs/k.mat:K"\n'


def test_the_commit_is_that_of_the_clone(tmp_path):
    package = tmp_path / "clone" / "solver" / "microslip"
    package.mkdir(parents=True)
    (tmp_path / "clone" / "setup.py").touch()
    assert commit(package) == ""
    git = tmp_path / "clone" / ".git"
    (git / "refs" / "heads").mkdir(parents=True)
    (git / "HEAD").write_text("ref: refs/heads/main\n")
    (git / "packed-refs").write_text("# pack-refs\n" + 40 * "b" + " refs/heads/main\n")
    assert commit(package) == 40 * "b"
    (git / "refs" / "heads" / "main").write_text(40 * "a" + "\n")
    assert commit(package) == 40 * "a"
    (git / "HEAD").write_text(40 * "c")
    assert commit(package) == 40 * "c"
    (git / "HEAD").write_text("rubbish")
    assert commit(package) == ""


def test_the_hash_distinguishes_edited_copies(tmp_path):
    (tmp_path / "a.py").write_text("x = 1\n")
    first = program_hash.__wrapped__(tmp_path)
    (tmp_path / "a.py").write_text("x = 2\n")
    assert len(first) == 8 and program_hash.__wrapped__(tmp_path) != first
    assert _PACKAGE == Path(microslip.__file__).parent
