"""What an iterative solver would take for the stuck structure, beside the factor that is kept.

    python jobs/bench/iterative.py [SCENE ...] [--rtol 1e-8] [--only TEXT]      and the same under mpirun -n 2

Conjugate gradients on K_L with the algebraic multigrid of PETSc (smoothed aggregation) and of hypre (BoomerAMG), which know the
rigid motions of the nodes, as users of such solvers set them for solids, and with the linear elements of the same mesh as the one
coarse level, which is factored.  The right-hand sides are the first load and the spring of one pair.  Needs the meshes of the
scenes, jobs/fan_paper.toml and jobs/lap_joint.toml unless told, of quadratic elements.  Prints a line for each preconditioner and
one for the factor: entries that are factored, processor time to set it up and for a solution, iterations, and how long all columns
of the joint would take at that rate.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import machine
import numpy as np
import scipy.sparse as sp
from mpi4py import MPI

from microslip.parallel.petsc import initialise

initialise()

from petsc4py import PETSc

import microslip
from microslip.elements.kinds import KINDS
from microslip.linear.dense import column_norms, multiply
from microslip.linear.factor import Factor

JOBS = Path(__file__).parents[1]
SCENES = (JOBS / "fan_paper.toml", JOBS / "lap_joint.toml")
PREFIX, MOST, N_COLUMNS = "iterative_", 1000, 16
LINEAR = {"hex20": "hex8", "tet10": "tet4", "wedge15": "wedge6"}
COARSE = "-pc_type mg -pc_mg_galerkin both -mg_coarse_ksp_type preonly -mg_coarse_pc_type cholesky "
COARSE += "-mg_coarse_pc_factor_mat_solver_type mumps -mg_levels_ksp_max_it 2 -mg_levels_pc_type "
ON_LINEAR = {
    "linear elements, two steps of SOR": COARSE + "sor",
    "linear elements, two steps of Jacobi by nodes": COARSE + "pbjacobi",
}
AGGREGATED = {
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


def from_linear_elements(structure: microslip.Structure) -> PETSc.Mat:
    """Return what interpolates motions of the mesh's linear elements to all its nodes, (n_dof, n_coarse).  Collective."""
    system, comm = structure.linearised.system, structure.comm
    assert system.dof is not None, "a scene with a mesh"
    between = comm.bcast(nodes_from_corners(structure.mesh) if comm.rank == 0 else None).tocoo()
    rows, columns = (system.dof[nodes].ravel() for nodes in (between.row, between.col))
    is_free = (rows >= 0) & (columns >= 0)
    corners, places = np.unique(columns[is_free], return_inverse=True)
    values = np.repeat(between.data, 3)[is_free]
    whole = sp.csr_matrix((values, (rows[is_free], places)), (system.n_dof, len(corners)))
    owned = slice(*system.M.getOwnershipRange())
    n_coarse = int(np.count_nonzero((corners >= owned.start) & (corners < owned.stop)))
    own = whole[owned]
    sizes = (own.shape[0], system.n_dof), (n_coarse, len(corners))
    return PETSc.Mat().createAIJ(sizes, csr=(own.indptr, own.indices, own.data), comm=comm)


def nodes_from_corners(mesh) -> sp.csr_matrix:
    """Return the shape functions of the linear elements at all nodes of a mesh of quadratic ones, (n_nodes, n_nodes).  Local."""
    n, found = len(mesh.points), []
    for block in mesh.elements:
        linear, nodes = KINDS[LINEAR[block.kind]], block.nodes
        values = linear.values(KINDS[block.kind].nodes)  # (n_nodes of the quadratic kind, of the linear one)
        i, j = np.nonzero(values)
        found.append((nodes[:, i].ravel(), nodes[:, j].ravel(), np.tile(values[i, j], len(nodes))))
    rows, columns, values = map(np.concatenate, zip(*found))
    _, first = np.unique(rows * n + columns, return_index=True)  # elements that share a node say the same of it
    return sp.csr_matrix((values[first], (rows[first], columns[first])), (n, n))


def solver(A: PETSc.Mat, options: str, rtol: float, coarse: PETSc.Mat | None) -> PETSc.KSP:
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
    if coarse is not None:
        ksp.getPC().setType(PETSc.PC.Type.MG)
        ksp.getPC().setMGLevels(2)
        ksp.getPC().setMGInterpolation(1, coarse)
    ksp.setFromOptions()
    ksp.setUp()
    return ksp


def line(name: str, entries: float, set_up: float, solve: float, iterations: str, error: float, n_columns: int) -> str:
    """Return a line of the table."""
    factored = f"{entries / 1e6:.1f}" if entries else "–"
    return f"| {name} | {factored} | {set_up:.1f} | {solve:.2f} | {iterations} | {error:.0e} | {n_columns * solve / 60.0:.1f} |"


def measured(structure: microslip.Structure, rtol: float, only: str):
    """Yield the lines of a structure, of the preconditioners whose names have a text.  Collective."""
    linearised, comm = structure.linearised, structure.comm
    A, system = linearised.K_L, linearised.system
    owned = slice(*A.getOwnershipRange())
    B = np.asfortranarray(np.column_stack([one.toarray().ravel()[owned] for one in (system.loads[:, 0], system.R[0].T)]))
    n_columns = system.R.shape[0]
    A.setBlockSize(3)
    yield from by_iteration(A, B, named(ON_LINEAR, only), rtol, n_columns, from_linear_elements(structure))
    know_motions(A, rigid_motions(structure))
    yield from by_iteration(A, B, named(AGGREGATED, only), rtol, n_columns)
    start = time.process_time()
    factor = Factor(A, system, last=np.unique(system.R.indices))
    factored = time.process_time()
    wide = np.random.default_rng(1).standard_normal((len(B), N_COLUMNS))
    X = factor.solver.solve(np.asfortranarray(wide))
    each = (time.process_time() - factored) / N_COLUMNS
    error = float(np.max(column_norms(comm, multiply(A, X) - wide) / column_norms(comm, wide)))
    yield line(f"the factor, {N_COLUMNS} solves at once", factor.info["entries"], factored - start, each, "–", error, n_columns)
    factor.destroy()


def named(kinds: dict[str, str], text: str) -> dict[str, str]:
    """Return those of some preconditioners whose names have a text.  Local."""
    return {name: options for name, options in kinds.items() if text in name}


def know_motions(A: PETSc.Mat, motions: np.ndarray) -> None:
    """Tell a matrix the rigid motions of its nodes, this rank's rows (n_owned, 6).  Collective."""
    vectors = []
    for motion in motions.T:
        vectors.append(A.createVecRight())
        vectors[-1].setArray(motion)
    A.setNearNullSpace(PETSc.NullSpace().create(vectors=vectors, comm=A.comm))


def by_iteration(
    A: PETSc.Mat, B: np.ndarray, kinds: dict[str, str], rtol: float, n_columns: int, coarse: PETSc.Mat | None = None
):
    """Yield a line for each of some preconditioners, on a coarse level where its interpolation is given.  Collective."""
    comm, (b, x) = A.comm.tompi4py(), A.createVecs()
    for name, options in kinds.items():
        start = time.process_time()
        ksp = solver(A, options, rtol, coarse)
        set_up = time.process_time() - start
        found, errors, start = [], [], time.process_time()
        for column in B.T:
            b.setArray(column)
            ksp.solve(b, x)
            found.append(ksp.getIterationNumber() if ksp.getConvergedReason() > 0 else f"not in {ksp.getIterationNumber()}")
            left = multiply(A, x.getArray().reshape(-1, 1)) - column[:, None]
            errors.append(float(column_norms(comm, left)[0] / column_norms(comm, column[:, None])[0]))
        solve = (time.process_time() - start) / B.shape[1]
        yield line(name, entries_of(ksp) if coarse else 0.0, set_up, solve, ", ".join(map(str, found)), max(errors), n_columns)
        ksp.destroy()


def entries_of(ksp: PETSc.KSP) -> float:
    """Return the entries of the coarse level's factor.  Local."""
    return float(ksp.getPC().getMGCoarseSolve().getPC().getFactorMatrix().getMumpsInfog(29))


def main() -> None:
    """Print the tables.  Collective."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", type=Path, default=SCENES)
    parser.add_argument("--rtol", type=float, default=1e-8)
    parser.add_argument("--only", default="", help="preconditioners whose names have this text")
    asked = parser.parse_args()
    here = MPI.COMM_WORLD.rank == 0
    if here:
        print(*machine.lines(machine.facts()), sep="\n")
    for scene in asked.scenes:
        with microslip.build(microslip.read(scene)) as structure:
            if here:
                print(f"\n{scene.name}: {structure.linearised.system.n_dof} DOF, {structure.pairs.n_pairs} pairs\n")
                print(
                    "| solver | factored, 10^6 entries | set-up, CPU s | a solution, CPU s | iterations | residual | all columns, min |"
                )
                print("| --- | ---: | ---: | ---: | ---: | ---: | ---: |", flush=True)
            for one in measured(structure, asked.rtol, asked.only):
                if here:
                    print(one, flush=True)


if __name__ == "__main__":
    main()
