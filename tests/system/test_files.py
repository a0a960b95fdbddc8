"""Files are complete or absent."""

import errno
import os
import resource
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

import microslip
from microslip.messages.errors import CaseError, ResourceError
from microslip.system.files import atomic_write, file_errors, make_folder


def test_the_new_file_appears_at_the_end(tmp_path):
    path = tmp_path / "x"
    path.write_text("old")
    with atomic_write(str(path)) as beside:
        with open(beside, "w") as file:
            file.write("new")
        assert path.read_text() == "old" and os.path.dirname(beside) == str(tmp_path)
    assert path.read_text() == "new" and os.listdir(tmp_path) == ["x"]


@pytest.mark.parametrize("problem", [KeyboardInterrupt, ValueError])
def test_a_failed_write_leaves_the_old_file(tmp_path, problem):
    path = tmp_path / "x"
    path.write_text("old")
    with pytest.raises(problem):
        with atomic_write(str(path)) as beside:
            open(beside, "w").close()
            raise problem
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["x"]


@pytest.mark.parametrize(
    "problem, error",
    [
        (OSError(errno.ENOSPC, "No space left on device"), ResourceError),
        (OSError(errno.EIO, "x"), ResourceError),
        (PermissionError(errno.EACCES, "x"), CaseError),
        (NotADirectoryError(errno.ENOTDIR, "x"), CaseError),
        (OSError("Can't write data (file write failed: errno = 28, error message = 'No space left on device')"), ResourceError),
        (OSError("Unable to create file (unable to open file: errno = 13, error message = 'Permission denied')"), CaseError),
        (RuntimeError("Can't decrement id ref count (file write failed: errno = 28)"), ResourceError),
        (CaseError("own"), CaseError),
    ],
)
def test_errors_of_the_system_have_their_status(problem, error):
    with pytest.raises(error) as caught:
        with file_errors("/some/file"):
            raise problem
    assert "own" in str(caught.value) or "/some/file" in str(caught.value)


def test_a_folder_in_the_place_of_a_file_is_rejected(tmp_path):
    (tmp_path / "x").write_text("")
    make_folder(str(tmp_path / "a" / "b"))
    make_folder(str(tmp_path / "a" / "b"))
    with pytest.raises(CaseError, match="another folder"):
        make_folder(str(tmp_path / "x" / "b"))


def test_a_limit_on_files_leaves_no_truncated_compiled_module(tmp_path):
    """The package, with a module larger than the limit, starts again without it: Python truncates a compiled module."""
    package = tmp_path / "microslip"
    (package / "system").mkdir(parents=True)
    for name in ("__init__.py", "version.py", "system/__init__.py", "system/blas.py"):
        shutil.copy(Path(microslip.__file__).parent / name, package / name)
    (package / "large.py").write_text("".join(f"value_{i} = {i}\n" for i in range(2000)))
    imports = [sys.executable, "-c", "import microslip.large"]
    for limit in (10_000, resource.RLIM_INFINITY):  # above the compiled start of the package, which sets the protection
        bound = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
        done = subprocess.run(imports, cwd=tmp_path, env={}, preexec_fn=bound, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")
