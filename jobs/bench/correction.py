"""Accuracy of the corrected amplitude and of its error bar: points of random structures against many more harmonics.

    PYTHONPATH=solver:tests python jobs/bench/correction.py [--systems 30] [--harmonics 1 3 5] [--reference 25]

Each point is solved with few harmonics and then, from that solution, with those of the reference.  Errors are those of the
complex amplitude of harmonic 1, relative to the largest of its curve; points with an error below 1e-6 are left out.
"""

import argparse
from typing import Any

from microslip.parallel.petsc import initialise

initialise()  # before anything imports PETSc

import numpy as np
from continuation.dense_model import forced, reduced
from mpi4py import MPI
from verification.random_structures import draw

from microslip.continuation.grid import range_of, solved_at, task_at
from microslip.continuation.iterate import Iterate
from microslip.continuation.point_solver import PointSolver, Workspace
from microslip.error_estimate.estimate import ErrorEstimator, output_amplitude
from microslip.messages.errors import MicroslipError
from microslip.points.error_parts import total
from microslip.points.selection import AllPairs
from microslip.receptance.truncated_modes import EnrichedModel

HERE = MPI.COMM_SELF
SEEN = 1e-6  # error over the peak
SAMPLES, OF_REFERENCE = 128, 512


def judged(system: dict[str, Any], level: float, H: int, reference: int) -> list:
    """Return a row per point of a level: errors and bars before and after, over the peak; whether pairs open or all move."""
    model, law = reduced(system, HERE, H)
    low, high = system["omega"]
    omegas = np.linspace(low, high, 10)[1:-1].tolist()
    estimator = ErrorEstimator(EnrichedModel.of_all_modes(model))
    task = task_at(forced(model, law, SAMPLES, level), AllPairs(), omegas, 1e-9, estimator)
    points = solved_at(task, omegas).points
    finer, _ = reduced(system, HERE, reference)
    problem = forced(finer, law, OF_REFERENCE, level)
    workspace = Workspace(problem.equation)
    solver, rows = PointSolver(problem, AllPairs(), range_of(omegas), 1e-10, workspace), []
    peak = max((np.hypot(*point.response[0, 1:3]) for point in points), default=1.0)
    for point in points:
        if point.error is None or point.corrected is None or point.error_corrected is None or not point.error.any():
            continue
        U = model.recorded.carry(point.U, finer.harmonics)
        true = amplitude(solver, Iterate(U, (point.omega,), finer.harmonics))
        if true is not None:
            errors = [abs(complex(*there) - true) for there in (point.response[0, 1:3], point.corrected[0])]
            bars = [total(point.error)[0], point.error_corrected[0]]
            rows.append([*(np.array([*errors, *bars]) / peak), (point.state == 2).any(), (point.state != 0).all()])
    workspace.destroy()
    return rows


def amplitude(solver, guess):
    """Return cos + i sin of harmonic 1 of the first output of the solution near a guess; None where Newton fails."""
    equation, at = solver.equation, solver.problem.at(guess.parameters)
    try:
        solution, _ = solver.solve_at(guess, float(np.linalg.norm(guess.U)), equation.every_pair)
    except MicroslipError:
        return None
    if solution.failure:
        return None
    forces = equation.contact_forces(solution.iterate.U, equation.every_pair, tangents=False)
    return complex(*output_amplitude(equation.model, at, equation.full_force(forces)).reshape(2, -1)[:, 0])


def row(name, rows):
    """Return a row of the table."""
    before, after, bar, remaining = rows[:, :4].T
    used = remaining < bar
    cells = [name, str(len(rows)), *(f"{np.median(e):.1e}; {np.quantile(e, 0.95):.1e}" for e in (before, after))]
    cells += [f"{100 * share:.1f} %" for share in (np.mean(used), np.mean(before <= bar), np.mean(after <= remaining))]
    return f"| {' | '.join([*cells, f'{np.median(remaining / bar):.2f}'])} |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--systems", type=int, default=30)
    parser.add_argument("--harmonics", type=int, nargs="+", default=[1, 3, 5])
    parser.add_argument("--reference", type=int, default=25)
    arguments, rows = parser.parse_args(), dict[int, list]()
    for system in (draw(1, number) for number in range(arguments.systems)):
        for level in system["levels"].values():
            for H in (H for H in arguments.harmonics if H >= max(load["harmonic"] for load in system["loads"])):
                try:
                    rows.setdefault(H, []).extend(judged(system, level, H, arguments.reference))
                except MicroslipError:  # no branch to begin with
                    continue
    print(
        "| points | number | error before: median; 95 % | after | corrected | within the bar | within what remains | bars, median ratio |"
    )
    print("| --- " * 8 + "|")
    for H, of_H in rows.items():
        seen = np.array([one for one in of_H if one[0] > SEEN])
        some = {"": seen, ", pairs open": seen[seen[:, 4] > 0], ", all move": seen[seen[:, 5] > 0]}
        for name, of in some.items():
            if len(of):
                print(row(f"H = {H}{name}", of), flush=True)


if __name__ == "__main__":
    main()
