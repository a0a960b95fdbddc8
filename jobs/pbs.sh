#!/bin/bash
# One scene on a cluster with PBS, or an array of jobs, each with other values in the scene:
#
#     qsub -v scene=jobs/fan_paper.toml jobs/pbs.sh
#     qsub -J 1-4 -v scene=jobs/fan_paper.toml,values=jobs/values.txt jobs/pbs.sh         (Torque: -t 1-4)
#
# Task i takes line i of the second file, words KEY=VALUE, and writes into results/NAME_i.  Adapt what follows;
# `microslip check SCENE.toml --set KEY=VALUE` says how much memory a scene will need, and whether a value fits.
#PBS -N microslip
#PBS -l select=1:ncpus=4:mpiprocs=4:mem=16gb
#PBS -l walltime=01:00:00
# A job that has to make room, or whose time is up, is told to end: frf.csv keeps every point and results.h5 every
# finished level.  Begun again it would start from the beginning, and in the same folder: qsub -r n forbids that,
# but not for arrays.
set -euo pipefail
cd "$PBS_O_WORKDIR"
scene="${scene:?the scene is missing: qsub -v scene=SCENE.toml jobs/pbs.sh}" values="${values:-}"
task="${PBS_ARRAY_INDEX:-${PBS_ARRAYID:-}}"

# module load ...                   the modules that microslip was installed with
. env/bin/activate                  # the environment of README.md, in the folder the job is sent from

export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1      # ranks, not threads, share the cores

# several levels at once, on two groups of two ranks:   mpirun microslip run --groups 2 SCENE.toml
# several scenes at once, each on one rank:             mpirun microslip run --groups 4 A.toml B.toml C.toml ...
# from a container of jobs/environments/apptainer.def:  mpirun apptainer exec microslip.sif microslip run SCENE.toml
arguments=("$scene")
if [ -n "$task" ]; then
    line=$(sed -n "${task}p" "${values:?an array needs values: qsub -J 1-4 -v scene=SCENE.toml,values=VALUES.txt jobs/pbs.sh}")
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
