"""Standard streams that are closed, full or not read: one message, the status of the problem, no traceback."""

import os
import subprocess
import sys

import pytest
from block_scenes import OF_CALCULIX, write_scene
from processes import LIMIT, environment

pytestmark = pytest.mark.ranks(1)


@pytest.fixture
def scene(tmp_path):
    return write_scene(tmp_path, OF_CALCULIX)


def shell(line: str, cwd, **variables) -> subprocess.CompletedProcess:
    """Run a line of bash, in which ``microslip`` is the program; return the status of the first command of a pipe."""
    program = f'microslip() {{ "{sys.executable}" -m microslip "$@"; }}; {line}; exit ${{PIPESTATUS[0]}}'
    env = environment(1) | variables
    return subprocess.run(["bash", "-c", program], cwd=cwd, env=env, capture_output=True, text=True, timeout=LIMIT, check=False)


def test_a_closed_pipe_of_the_output_stops_a_run(scene):
    done = shell(f"microslip run {scene} --out out | head -c 1", scene.parent)
    assert done.returncode == 5 and done.stderr.strip().endswith("the reader of standard output has closed it")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
@pytest.mark.parametrize("command", ["check scene.toml", "diff results.h5 results.h5 --help"])
def test_a_full_disk_of_the_output_is_reported(scene, command):
    done = shell(f"microslip {command} > /dev/full", scene.parent)
    assert done.returncode == 4 and "No space left on device" in done.stderr and "Traceback" not in done.stderr


def test_closed_streams_do_not_change_the_status(scene):
    wrong = shell("microslip check absent.toml >&-", scene.parent)
    assert wrong.returncode == 2 and "absent.toml" in wrong.stderr and "Traceback" not in wrong.stderr
    done = shell(f"microslip run {scene} --out out 2>&-", scene.parent)
    assert done.returncode == 0 and done.stdout.rstrip().endswith("done")


@pytest.mark.parametrize(
    "variables", [{"PYTHONIOENCODING": "latin-1"}, {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}]
)
def test_encodings_without_some_letters_do_not_stop_a_run(scene, variables):
    odd = scene.with_name("Ωmega.toml")
    odd.write_bytes(scene.read_bytes())
    done = shell(f"microslip run {odd.name} --out out", scene.parent, **variables)
    assert done.returncode == 0, done.stderr


def test_a_scene_whose_file_name_is_no_text_runs(scene):
    odd = os.fsencode(scene.parent) + b"/sc\xff.toml"
    with open(odd, "wb") as file:
        file.write(scene.read_bytes())
    done = shell("microslip run sc$'\\xff'.toml --out out", scene.parent)
    assert done.returncode == 0, done.stderr
