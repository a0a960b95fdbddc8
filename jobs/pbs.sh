#!/bin/bash
# One scene on a cluster with PBS:
#
#     qsub -v scene=jobs/fan_paper.toml jobs/pbs.sh
#
# Adapt what follows; `microslip check SCENE.toml` says how much memory a scene will need.
#PBS -N microslip
#PBS -l select=1:ncpus=4:mpiprocs=4:mem=16gb
#PBS -l walltime=01:00:00
set -euo pipefail
cd "$PBS_O_WORKDIR"

# module load ...                   the modules that microslip was installed with
. env/bin/activate                  # the environment of README.md, in the folder the job is sent from

export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1      # ranks, not threads, share the cores

# several levels at once, on two groups of two ranks:   mpirun microslip run --groups 2 SCENE.toml
# several scenes at once, each on one rank:             mpirun microslip run --groups 4 A.toml B.toml C.toml ...
mpirun microslip run "${scene:?the scene is missing: qsub -v scene=SCENE.toml jobs/pbs.sh}"
