"""The scripts for clusters, run as by a scheduler: with its variables, in the folder from which a job is submitted."""

import os
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest
from matrix_scenes import write_matrix_scene
from oracles import scenes
from processes import LIMIT, MPIRUN, environment, wait_for
from sources import ROOT

from microslip.scene.read import read_scene

SLURM, PBS = ROOT / "jobs" / "slurm.sh", ROOT / "jobs" / "pbs.sh"
ECHO = 'echo "$@" > output'  # in place of mpirun


def job(folder, script, scene="scene.toml", values="", task=None, launcher=ECHO, **more):
    """Return the process of a job: ``script`` with the scheduler's variables, an environment ``env`` and ``launcher``."""
    commands = {"mpirun": launcher, "microslip": f'exec {sys.executable} -m microslip "$@"'}
    commands |= {name: f'echo {name} "$@" > queued' for name in ("scontrol", "qsub")}
    (folder / "env" / "bin").mkdir(parents=True, exist_ok=True)
    (folder / "env" / "bin" / "activate").write_text(f"PATH={folder}/env/bin:$PATH\n")
    for name, command in commands.items():
        (folder / "env" / "bin" / name).write_text(f"#!/bin/bash\n{command}\n")
        (folder / "env" / "bin" / name).chmod(0o755)
    if script == SLURM:
        arguments, own = [scene, values][: 2 if values else 1 if scene else 0], {"SLURM_ARRAY_TASK_ID": task}
    else:
        arguments, own = [], {"PBS_O_WORKDIR": folder, "PBS_ARRAY_INDEX": task, "scene": scene, "values": values or None}
    own |= more
    variables = environment() | {name: str(value) for name, value in own.items() if value is not None}
    command = ["bash", str(script), *arguments]
    where = folder if script == SLURM else folder.parent
    return subprocess.Popen(command, cwd=where, env=variables, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def ended(process):
    """Return status and output of a job."""
    output = process.communicate(timeout=LIMIT)[0]
    return process.returncode, output


@pytest.mark.parametrize("script", [SLURM, PBS], ids=["slurm", "pbs"])
def test_the_scripts_launch_the_run(tmp_path, script):
    (tmp_path / "values.txt").write_text("joints.a.friction=0.1\njoints.a.friction=0.2 response.levels=[1.0,2.0]\n")
    assert ended(job(tmp_path, script, "jobs/fan.toml")) == (0, "")
    assert (tmp_path / "output").read_text() == "microslip run jobs/fan.toml\n"
    assert ended(job(tmp_path, script, "jobs/fan.toml", "values.txt", task=2)) == (0, "")
    assert (tmp_path / "output").read_text() == (
        "microslip run jobs/fan.toml --set=joints.a.friction=0.2 --set=response.levels=[1.0,2.0] --out results/fan_2\n"
    )
    assert ended(job(tmp_path, script, launcher="exit 3")) == (3, "")


@pytest.mark.parametrize("script", [SLURM, PBS], ids=["slurm", "pbs"])
def test_missing_arguments_are_reported_and_nothing_is_launched(tmp_path, script):
    (tmp_path / "values.txt").write_text("joints.a.friction=0.1\n")
    for settings, message in (
        ({"scene": ""}, "the scene is missing"),
        ({"task": 1}, "an array needs values"),
        ({"values": "values.txt", "task": 2}, "there is no line 2 of values in values.txt"),
        ({"values": "nowhere.txt", "task": 1}, "nowhere.txt"),
    ):
        status, output = ended(job(tmp_path, script, **settings))
        assert status != 0 and message in output and not (tmp_path / "output").exists()


@pytest.mark.parametrize("script", [SLURM, PBS], ids=["slurm", "pbs"])
def test_a_signal_is_passed_to_the_run_and_its_status_is_returned(tmp_path, script):
    launcher = "trap 'kill $!; echo told > told; exit 5' TERM\nsleep 60 > /dev/null 2>&1 &\necho begun > begun\nwait"
    process = job(tmp_path, script, launcher=launcher)
    wait_for(tmp_path / "begun")
    process.send_signal(signal.SIGTERM)
    assert ended(process) == (5, "") and (tmp_path / "told").exists()


STOPS = "mkdir -p results/fan_1\necho row >> results/fan_1/frf.csv\nexit 5"  # in time, with a point more


@pytest.mark.parametrize(
    "script, number, first, later",
    [
        (SLURM, "7", "scontrol requeue 7\n", {"SLURM_RESTART_COUNT": 50}),
        (
            PBS,
            "7.host",
            "qsub -W depend=afterany:7.host -v scene=fan.toml,times=1,values=values.txt,task=1 jobs/pbs.sh\n",
            {"times": 50},
        ),
        # qsub of PBS Pro refuses a dependency on a subjob: "cannot have dependancy on subjob or range" (OpenPBS, parse_depend.c)
        (PBS, "7[1].host", "qsub -v scene=fan.toml,times=1,values=values.txt,task=1 jobs/pbs.sh\n", {"times": 50}),
    ],
    ids=["slurm", "pbs", "pbs-array"],
)
def test_a_run_stopped_by_its_time_limit_is_requeued_while_it_makes_progress(tmp_path, script, number, first, later):
    (tmp_path / "values.txt").write_text("joints.a.friction=0.1\n")
    queued, settings = tmp_path / "queued", {"scene": "fan.toml", "values": "values.txt", "task": 1}
    settings |= {"SLURM_JOB_ID": number, "PBS_JOBID": number}
    for _ in range(2):
        assert ended(job(tmp_path, script, **settings, launcher=STOPS)) == (5, "")
        assert queued.read_text() == first
        queued.unlink()
    for launcher, more in (("exit 5", {}), (STOPS, later)):
        status, output = ended(job(tmp_path, script, **settings, launcher=launcher, **more))
        assert status == 5 and "not put into the queue again: results/fan_1 made no progress" in output and not queued.exists()
    status, output = ended(job(tmp_path, script, **settings, launcher=STOPS.replace("exit 5", "exit 3")))
    assert (status, output) == (3, "") and not queued.exists()


@pytest.mark.slow
def test_a_task_of_an_array_on_two_ranks(tmp_path):
    write_matrix_scene(tmp_path, scenes.spatial_mass(), [0.02], (1.0, 1.6), outputs=[0], points=5)
    (tmp_path / "values.txt").write_text("response.levels=[0.01]\nresponse.levels=[0.03] solver.harmonics=5\n")
    status, output = ended(job(tmp_path, SLURM, values="values.txt", task=2, launcher=f'{MPIRUN} --oversubscribe -n 2 "$@"'))
    assert status == 0, output
    assert os.listdir(tmp_path / "results") == ["scene_2"]
    out = tmp_path / "results" / "scene_2"
    assert set(np.loadtxt(out / "frf.csv", delimiter=",", skiprows=1, usecols=0)) == {0.03}
    assert "scene.toml --set response.levels=[0.03] --set solver.harmonics=5\n" in (out / "run.log").read_text()


def test_the_example_values_are_valid_for_the_demo():
    lines = (ROOT / "jobs" / "values.txt").read_text().splitlines()
    assert len(lines) == 4
    for line in lines:
        read_scene(ROOT / "jobs" / "fan_small.toml", line.split())


@pytest.mark.skipif(shutil.which("shellcheck") is None, reason="needs shellcheck")
def test_scripts_pass_shellcheck():
    files = [*(ROOT / "jobs").glob("*.sh"), ROOT / ".ci" / "run", ROOT / ".ci" / "packages"]
    process = subprocess.run(["shellcheck", "--exclude=SC1091", *map(str, files)], capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stdout


@pytest.mark.parametrize("script", ["slurm_sweep.sh", "pbs_sweep.sh"])
def test_a_task_of_a_sweep_computes_its_part(tmp_path, script):
    options = ["--scatter", "level=10", "--samples", "8"]
    own = {"SLURM_ARRAY_TASK_ID": 3, "SLURM_ARRAY_TASK_COUNT": 5}
    own |= {"PBS_ARRAY_INDEX": 3, "PBS_O_WORKDIR": tmp_path, "scene": "scene.toml", "parts": 5, "options": " ".join(options)}
    job(tmp_path, SLURM, scene="")  # makes the commands
    arguments = ["scene.toml", *options] if script.startswith("slurm") else []
    command = ["bash", str(ROOT / "jobs" / script), *arguments]
    variables = environment() | {name: str(value) for name, value in own.items()}
    subprocess.run(command, cwd=tmp_path, env=variables, check=True, timeout=LIMIT)
    assert (tmp_path / "output").read_text() == f"microslip sweep scene.toml {' '.join(options)} --part 3/5\n"
