"""Groups of ranks as started by a user: options and a signal; a level that fails: tests/parallel/test_mpi_groups.py."""

import os
import re
import signal
import subprocess
import sys
import time

from matrix_scenes import write_matrix_scene
from oracles import scenes
from processes import LIMIT, MPIRUN, environment, microslip


def test_two_scenes_on_two_groups_and_an_unused_option(tmp_path):
    write_matrix_scene(tmp_path, scenes.spatial_mass(), [0.02], (1.0, 1.6), outputs=[0], points=5)
    (tmp_path / "other.toml").write_text((tmp_path / "scene.toml").read_text())
    options = ("-hb_snes_max_it", "40", "-hb_snes_maxit", "40")
    done = microslip("run", "scene.toml", "--groups", "2", "other.toml", "--", *options, ranks=3, cwd=tmp_path)
    assert done.returncode == 2 and done.stderr.count("microslip: error: -hb_snes_maxit: no solver of this run reads") == 1
    assert (
        re.search(r"^other: done after .* s, see results/other$", done.stdout, re.MULTILINE)
        and len(done.stdout.splitlines()) == 4
    )
    for name in ("scene", "other"):
        assert {"frf.csv", "results.h5", "run.log", "response.png"} <= {
            path.name for path in (tmp_path / "results" / name).iterdir()
        }


def test_a_signal_ends_all_groups_and_saves_the_points(tmp_path):
    write_matrix_scene(tmp_path, scenes.spatial_mass(), [0.1, 0.4, 0.3, 0.2], (1.0, 1.6), outputs=[0], points=20000)
    command = [
        MPIRUN,
        "--oversubscribe",
        "-n",
        "2",
        sys.executable,
        "-m",
        "microslip",
        "run",
        "scene.toml",
        "--groups",
        "2",
        "--out",
        "o",
    ]
    job = subprocess.Popen(command, cwd=tmp_path, env=environment(), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        table, deadline = tmp_path / "o" / "frf.csv", time.monotonic() + LIMIT
        while (
            not table.exists() or len({line.split(",")[0] for line in table.read_text().splitlines()}) < 3
        ):  # header, two levels
            assert time.monotonic() < deadline and job.poll() is None
            time.sleep(0.05)
        os.kill(job.pid, signal.SIGTERM)
        messages = job.communicate(timeout=LIMIT)[1]
    finally:
        job.kill()
    assert job.returncode != 0 and "Traceback" not in messages and messages.count("stopped by SIGTERM") <= 1
    levels = {float(line.split(",")[0]) for line in table.read_text().splitlines()[1:]}
    assert levels == {0.4, 0.3}
