#!/bin/bash
# One scene on a cluster with Slurm:
#
#     sbatch jobs/slurm.sh jobs/fan_paper.toml
#
# Adapt what follows; `microslip check SCENE.toml` says how much memory a scene will need.
#SBATCH --job-name=microslip
#SBATCH --ntasks=4
#SBATCH --cpus-per-task=1
#SBATCH --mem-per-cpu=4G
#SBATCH --time=01:00:00
set -euo pipefail

# module load ...                   the modules that microslip was installed with
. env/bin/activate                  # the environment of README.md, in the folder the job is sent from

export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1      # ranks, not threads, share the cores

# several levels at once, on two groups of two ranks:   mpirun microslip run --groups 2 SCENE.toml
# several scenes at once, each on one rank:             mpirun microslip run --groups 4 A.toml B.toml C.toml ...
mpirun microslip run "${1:?the scene is missing: sbatch jobs/slurm.sh SCENE.toml}"
