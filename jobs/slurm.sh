#!/bin/bash
# One scene on a cluster with Slurm, or an array of jobs, each with other values in the scene:
#
#     sbatch jobs/slurm.sh jobs/fan_paper.toml
#     sbatch --array=1-4 jobs/slurm.sh jobs/fan_paper.toml jobs/values.txt
#
# Task i uses line i of the second file, words KEY=VALUE, and writes into results/NAME_i.  Adapt the lines below;
# `microslip check SCENE.toml --set KEY=VALUE` predicts the memory of a scene and checks the values.
#SBATCH --job-name=microslip
#SBATCH --ntasks=4
#SBATCH --cpus-per-task=1
#SBATCH --mem-per-cpu=4G
#SBATCH --time=01:00:00
# Shortly before its time limit the run saves and stops, status 5, and the job is put into the queue again: the same command
# continues the run, also if Slurm itself restarts the job.  A job without progress is not put into the queue again.
#SBATCH --requeue
#SBATCH --open-mode=append
most=50                            # largest number of times a job is put into the queue again
set -euo pipefail
scene="${1:?the scene is missing: sbatch jobs/slurm.sh SCENE.toml}" values="${2:-}" task="${SLURM_ARRAY_TASK_ID:-}"

# module load ...                   the modules that microslip was installed with
. env/bin/activate                  # the environment of README.md, in the folder the job is sent from

export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1      # ranks, not threads, share the cores
export OMPI_MCA_odls_base_sigkill_timeout=3      # s after which mpirun tells the ranks to end, and again until it kills them

# several levels at once, on two groups of two ranks:   mpirun microslip run --groups 2 SCENE.toml
# several scenes at once, each on one rank:             mpirun microslip run --groups 4 A.toml B.toml C.toml ...
# from a container of jobs/environments/apptainer.def:  mpirun apptainer exec microslip.sif microslip run SCENE.toml
arguments=("$scene")
if [ -n "$task" ]; then
    line=$(sed -n "${task}p" "${values:?an array needs values: sbatch --array=1-4 jobs/slurm.sh SCENE.toml VALUES.txt}")
    read -ra settings <<< "${line:?there is no line $task of values in $values}"
    arguments+=("${settings[@]/#/--set=}" --out "results/$(basename "$scene" .toml)_$task")
fi

out="results/$(basename "$scene" .toml)${task:+_$task}"
progress() { { find "$out" -type f ! -name "*.lock"; find "$out" -name frf.csv -exec cat {} +; } 2> /dev/null | wc -l || true; }
before=$(progress)

signalled=
trap 'signalled=1; kill -TERM %1 2> /dev/null || true' TERM
mpirun microslip run "${arguments[@]}" &
run=$!
status=0
wait "$run" || status=$?
if [ -n "$signalled" ]; then            # the signal ended the wait, not the run
    status=0
    wait "$run" || status=$?
fi
if [ "$status" = 5 ] && [ -z "$signalled" ]; then      # a job that gets a signal was cancelled or preempted
    if [ "$(progress)" -gt "$before" ] && [ "${SLURM_RESTART_COUNT:-0}" -lt "$most" ]; then
        scontrol requeue "${SLURM_JOB_ID:?}"
    else
        echo "not put into the queue again: $out made no progress, or was put there $most times; request more time" >&2
    fi
fi
exit "$status"
