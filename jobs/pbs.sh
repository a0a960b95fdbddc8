#!/bin/bash
# One scene on a cluster with PBS, or an array of jobs, each with other values in the scene:
#
#     qsub -v scene=jobs/fan_paper.toml jobs/pbs.sh
#     qsub -J 1-4 -v scene=jobs/fan_paper.toml,values=jobs/values.txt jobs/pbs.sh         (Torque: -t 1-4)
#
# Task i uses line i of the second file, words KEY=VALUE, and writes into results/NAME_i.  Adapt the lines below;
# `microslip check SCENE.toml --set KEY=VALUE` predicts the memory of a scene and checks the values.
#PBS -N microslip
#PBS -l select=1:ncpus=4:mpiprocs=4:mem=16gb
#PBS -l walltime=01:00:00
# Shortly before its time limit the run saves and stops, status 5, and is put into the queue again as a new job, which waits for
# the end of this one (for a job of an array, without waiting): the same command continues the run.  A job without progress is not
# put into the queue again.  Options of qsub other than -v are lost then: write them here.
most=50                            # largest number of times a job is put into the queue again
set -euo pipefail
cd "$PBS_O_WORKDIR"
scene="${scene:?the scene is missing: qsub -v scene=SCENE.toml jobs/pbs.sh}" values="${values:-}"
task="${PBS_ARRAY_INDEX:-${PBS_ARRAYID:-${task:-}}}" times="${times:-0}"

# module load ...                   the modules that microslip was installed with
. env/bin/activate                  # the environment of README.md, in the folder the job is sent from

export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1      # ranks, not threads, share the cores
export OMPI_MCA_odls_base_sigkill_timeout=3      # s after which mpirun tells the ranks to end, and again until it kills them

# several levels at once, on two groups of two ranks:   mpirun microslip run --groups 2 SCENE.toml
# several scenes at once, each on one rank:             mpirun microslip run --groups 4 A.toml B.toml C.toml ...
# from a container of jobs/environments/apptainer.def:  mpirun apptainer exec microslip.sif microslip run SCENE.toml
arguments=("$scene")
if [ -n "$task" ]; then
    line=$(sed -n "${task}p" "${values:?an array needs values: qsub -J 1-4 -v scene=SCENE.toml,values=VALUES.txt jobs/pbs.sh}")
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
if [ "$status" = 5 ] && [ -z "$signalled" ]; then      # a job that gets a signal was deleted or preempted
    if [ "$(progress)" -gt "$before" ] && [ "$times" -lt "$most" ]; then
        again="scene=$scene,times=$((times + 1))${values:+,values=$values}${task:+,task=$task}"
        case "${PBS_JOBID:?}" in
            *\[*) qsub -v "$again" "${script:-jobs/pbs.sh}" ;;      # PBS has no dependency on one job of an array; its run has ended
            *) qsub -W "depend=afterany:$PBS_JOBID" -v "$again" "${script:-jobs/pbs.sh}" ;;
        esac
    else
        echo "not put into the queue again: $out made no progress, or was put there $most times; request more time" >&2
    fi
fi
exit "$status"
