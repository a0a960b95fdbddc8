#!/bin/bash
# One scene on a cluster with Slurm, or an array of jobs, each with other values in the scene:
#
#     sbatch jobs/slurm.sh jobs/fan_paper.toml
#     sbatch --array=1-4 jobs/slurm.sh jobs/fan_paper.toml jobs/values.txt
#
# Task i takes line i of the second file, words KEY=VALUE, and writes into results/NAME_i.  Adapt what follows;
# `microslip check SCENE.toml --set KEY=VALUE` says how much memory a scene will need, and whether a value fits.
#SBATCH --job-name=microslip
#SBATCH --ntasks=4
#SBATCH --cpus-per-task=1
#SBATCH --mem-per-cpu=4G
#SBATCH --time=01:00:00
# A minute before its time is up, and where it has to make room, the job is told to end: frf.csv keeps every point
# and results.h5 every finished level.  Begun again it would start from the beginning, and in the same folder.
#SBATCH --signal=B:TERM@60
#SBATCH --no-requeue
set -euo pipefail
scene="${1:?the scene is missing: sbatch jobs/slurm.sh SCENE.toml}" values="${2:-}" task="${SLURM_ARRAY_TASK_ID:-}"

# module load ...                   the modules that microslip was installed with
. env/bin/activate                  # the environment of README.md, in the folder the job is sent from

export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1      # ranks, not threads, share the cores

# several levels at once, on two groups of two ranks:   mpirun microslip run --groups 2 SCENE.toml
# several scenes at once, each on one rank:             mpirun microslip run --groups 4 A.toml B.toml C.toml ...
# from a container of jobs/environments/apptainer.def:  mpirun apptainer exec microslip.sif microslip run SCENE.toml
arguments=("$scene")
if [ -n "$task" ]; then
    line=$(sed -n "${task}p" "${values:?an array needs values: sbatch --array=1-4 jobs/slurm.sh SCENE.toml VALUES.txt}")
    read -ra settings <<< "${line:?there is no line $task of values in $values}"
    arguments+=("${settings[@]/#/--set=}" --out "results/$(basename "$scene" .toml)_$task")
fi

told=
trap 'told=1; kill -TERM %1 2> /dev/null || true' TERM
mpirun microslip run "${arguments[@]}" &
run=$!
status=0
wait "$run" || status=$?
if [ -n "$told" ]; then            # the signal has ended the wait, not the run
    status=0
    wait "$run" || status=$?
fi
exit "$status"
