#!/bin/bash
# A sweep as an array of jobs with PBS: task I of N computes every N-th sample, and the last to end writes the whole table:
#
#     qsub -J 1-8 -v scene=jobs/fan_paper.toml,parts=8,options="--scatter joints.dovetail.friction=30 --samples 256" jobs/pbs_sweep.sh
#
# The array begins at 1.  Every rank has its own structure and samples (--groups G: fewer).  Adapt the lines below.
#PBS -N sweep
#PBS -l select=1:ncpus=4:mpiprocs=4:mem=16gb
#PBS -l walltime=01:00:00
# Every sample is stored when it is solved: a job that is stopped or restarted continues from there.
set -euo pipefail
cd "$PBS_O_WORKDIR"
scene="${scene:?the scene is missing: qsub -J 1-8 -v scene=SCENE.toml,parts=8,options=... jobs/pbs_sweep.sh}"
task="${PBS_ARRAY_INDEX:-${PBS_ARRAYID:?send it as an array: qsub -J 1-8 ...}}"
read -ra words <<< "${options:?options of the sweep are missing, as --scatter KEY=PERCENT}"

# module load ...                   the modules that microslip was installed with
. env/bin/activate                  # the environment of README.md, in the folder the job is sent from

export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1      # ranks, not threads, share the cores
exec mpirun microslip sweep "$scene" "${words[@]}" --part "$task/${parts:?how many parts there are}"
