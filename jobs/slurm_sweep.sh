#!/bin/bash
# A sweep as an array of jobs with Slurm: task I of N computes every N-th sample, and the last to end writes the whole table:
#
#     sbatch --array=1-8 jobs/slurm_sweep.sh jobs/fan_paper.toml --scatter joints.dovetail.friction=30 --samples 256
#
# The array begins at 1.  Every rank has its own structure and samples (--groups G: fewer).  Adapt the lines below.
#SBATCH --job-name=sweep
#SBATCH --ntasks=4
#SBATCH --cpus-per-task=1
#SBATCH --mem-per-cpu=4G
#SBATCH --time=01:00:00
# Every sample is stored when it is solved: a job that is stopped or restarted continues from there.
#SBATCH --requeue
#SBATCH --open-mode=append
set -euo pipefail
scene="${1:?the scene is missing: sbatch --array=1-8 jobs/slurm_sweep.sh SCENE.toml --scatter KEY=PERCENT}"
part="${SLURM_ARRAY_TASK_ID:?send it as an array: sbatch --array=1-8 ...}/${SLURM_ARRAY_TASK_COUNT:?}"

# module load ...                   the modules that microslip was installed with
. env/bin/activate                  # the environment of README.md, in the folder the job is sent from

export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1      # ranks, not threads, share the cores
exec mpirun microslip sweep "$scene" "${@:2}" --part "$part"
