"""What an iterative solver would take for the stuck structure, beside the factor that is kept.

    python jobs/bench/iterative.py [SCENE ...] [--rtol 1e-8]      and the same under mpirun -n 2

Conjugate gradients on K_L with the algebraic multigrid of PETSc (smoothed aggregation) and of hypre (BoomerAMG), which know the
rigid motions of the nodes, as users of such solvers set them for solids.  The right-hand sides are the first load and the spring
of one pair.  Needs the meshes of the scenes, jobs/fan_paper.toml and jobs/lap_joint.toml unless told.  Prints a line for each
preconditioner and one for the factor: processor time to set it up and for a solution, iterations, and how long all columns of the
joint would take at that rate.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import machine
import numpy as np
from mpi4py import MPI

from microslip.parallel.petsc import initialise

initialise()

from petsc4py import PETSc

import microslip
from microslip.linear.dense import column_norms, multiply
from microslip.linear.factor import Factor

JOBS = Path(__file__).parents[1]
SCENES = (JOBS / "fan_paper.toml", JOBS / "lap_joint.toml")
PREFIX, MOST, N_COLUMNS = "iterative_", 1000, 16
PRECONDITIONERS = {
    "smoothed aggregation": "-pc_type gamg",
    "the same, weak couplings dropped": "-pc_type gamg -pc_gamg_threshold 0.02",
    "the same, four steps of its smoother": "-pc_type gamg -pc_gamg_threshold 0.02 -mg_levels_ksp_max_it 4",
    "BoomerAMG by nodes": "-pc_type hypre -pc_hypre_type boomeramg -pc_hypre_boomeramg_strong_threshold 0.5 "
    "-pc_hypre_boomeramg_nodal_coarsen 6 -pc_hypre_boomeramg_vec_interp_variant 2 -pc_hypre_boomeramg_no_CF",
}


def rigid_motions(structure: microslip.Structure) -> np.ndarray:
    """Return the translations and rotations of the nodes, this rank's rows (n_owned, 6), orthonormal.  Collective."""
    system, comm = structure.linearised.system, structure.comm
    assert system.dof is not None, "a scene with a mesh"
    points = comm.bcast(structure.mesh.points if comm.rank == 0 else None)
    motions, x = np.zeros((system.n_dof, 6)), points - points.mean(axis=0)
    turned = np.cross(np.eye(3), x[:, None])  # (n_nodes, rotation, axis)
    for axis in range(3):
        is_free = system.dof[:, axis] >= 0
        rows = system.dof[is_free, axis]
        motions[rows, axis], motions[rows, 3:] = 1.0, turned[is_free, :, axis]
    return np.linalg.qr(motions)[0][slice(*system.M.getOwnershipRange())]


def solver(A: PETSc.Mat, options: str, rtol: float) -> PETSc.KSP:
    """Return conjugate gradients with the preconditioner that the options name, set up.  Collective."""
    names = PETSc.Options()
    for name in [name for name in names.getAll() if name.startswith(PREFIX)]:
        names.delValue(name)
    names.insertString(options.replace("-pc_", f"-{PREFIX}pc_").replace("-mg_", f"-{PREFIX}mg_"))
    ksp = PETSc.KSP().create(A.comm)
    ksp.setOptionsPrefix(PREFIX)
    ksp.setOperators(A)
    ksp.setType(PETSc.KSP.Type.CG)
    ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
    ksp.setTolerances(rtol=rtol, max_it=MOST)
    ksp.setFromOptions()
    ksp.setUp()
    return ksp


def line(name: str, set_up: float, solve: float, iterations: str, error: float, n_columns: int) -> str:
    """Return a line of the table."""
    return f"| {name} | {set_up:.1f} | {solve:.2f} | {iterations} | {error:.0e} | {n_columns * solve / 60.0:.1f} |"


def measured(structure: microslip.Structure, rtol: float):
    """Yield the lines of a structure.  Collective."""
    linearised, comm = structure.linearised, structure.comm
    A, system = linearised.K_L, linearised.system
    owned = slice(*A.getOwnershipRange())
    B = np.asfortranarray(np.column_stack([one.toarray().ravel()[owned] for one in (system.loads[:, 0], system.R[0].T)]))
    n_columns = system.R.shape[0]
    yield from by_iteration(A, B, rigid_motions(structure), rtol, n_columns)
    start = time.process_time()
    factor = Factor(A, system, last=np.unique(system.R.indices))
    factored = time.process_time()
    wide = np.random.default_rng(1).standard_normal((len(B), N_COLUMNS))
    X = factor.solver.solve(np.asfortranarray(wide))
    each = (time.process_time() - factored) / N_COLUMNS
    error = float(np.max(column_norms(comm, multiply(A, X) - wide) / column_norms(comm, wide)))
    yield line(f"the factor, {N_COLUMNS} solves at once", factored - start, each, "–", error, n_columns)
    factor.destroy()


def by_iteration(A: PETSc.Mat, B: np.ndarray, motions: np.ndarray, rtol: float, n_columns: int):
    """Yield a line for each preconditioner.  Collective."""
    comm, vectors = A.comm.tompi4py(), []
    for motion in motions.T:
        vectors.append(A.createVecRight())
        vectors[-1].setArray(motion)
    A.setBlockSize(3)
    A.setNearNullSpace(PETSc.NullSpace().create(vectors=vectors, comm=A.comm))
    b, x = A.createVecs()
    for name, options in PRECONDITIONERS.items():
        start = time.process_time()
        ksp = solver(A, options, rtol)
        set_up = time.process_time() - start
        found, errors, start = [], [], time.process_time()
        for column in B.T:
            b.setArray(column)
            ksp.solve(b, x)
            found.append(ksp.getIterationNumber() if ksp.getConvergedReason() > 0 else f"not in {ksp.getIterationNumber()}")
            left = multiply(A, x.getArray().reshape(-1, 1)) - column[:, None]
            errors.append(float(column_norms(comm, left)[0] / column_norms(comm, column[:, None])[0]))
        solve = (time.process_time() - start) / B.shape[1]
        yield line(name, set_up, solve, ", ".join(map(str, found)), max(errors), n_columns)
        ksp.destroy()


def main() -> None:
    """Print the tables.  Collective."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", type=Path, default=SCENES)
    parser.add_argument("--rtol", type=float, default=1e-8)
    asked = parser.parse_args()
    here = MPI.COMM_WORLD.rank == 0
    if here:
        print(*machine.lines(machine.facts()), sep="\n")
    for scene in asked.scenes:
        with microslip.build(microslip.read(scene)) as structure:
            if here:
                print(f"\n{scene.name}: {structure.linearised.system.n_dof} DOF, {structure.pairs.n_pairs} pairs\n")
                print("| solver | set-up, CPU s | a solution, CPU s | iterations | residual | all columns, min |")
                print("| --- | ---: | ---: | ---: | ---: | ---: |", flush=True)
            for one in measured(structure, asked.rtol):
                if here:
                    print(one, flush=True)


if __name__ == "__main__":
    main()
