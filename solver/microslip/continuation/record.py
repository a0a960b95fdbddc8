"""What is kept of a converged point: motion, forces, energies and states, gathered on rank 0."""

from __future__ import annotations

import numpy as np

from ..error_bars.estimate import ErrorEstimator
from ..harmonic.aft import contact_work, pair_energy
from ..harmonic.fourier import cycle_work
from ..harmonic.residual import HarmonicBalance
from ..reduction import receptance
from ..reduction.model import ReducedModel
from ..reduction.selection import Selection
from .branch import Point
from .corrector import Correction

HELD = "mean slip held by springs"      # the note of such a point


def point_record(problem: HarmonicBalance, found: Correction, selected: np.ndarray, selection: Selection,
                 asked: bool, estimator: ErrorEstimator | None = None) -> tuple[Point, np.ndarray]:
    """Return the record of a converged point and which pairs of all have p != 0, (n_pairs,) bool.

    Collective on ``problem.comm``.  State, energy and the set of moving pairs come from all pairs; ``p`` is that of the selected
    pairs, which the motion solves for.  With an ``estimator`` the point has error bars.
    """
    model, U = problem.model, found.iterate.U
    omega, level = problem.omega_at(found.iterate.parameter), problem.level_at(found.iterate.parameter)
    everything = np.ones(model.n_pairs, dtype=bool)
    of_all = problem.contact_forces(U, everything, tangents=False)
    used = of_all if selected.all() else problem.contact_forces(U, selected, tangents=False)
    p = problem.full_force(used)
    shape, harmonics, recorded = (model.n_pairs, 3, model.N_H), model.harmonics, model.recorded
    U_all = problem.gather(U)
    state = problem.gather(of_all.state)
    moves, energy = np.zeros(model.n_pairs, dtype=bool), np.zeros(model.n_pairs)
    moves[of_all.active] = True
    energy[of_all.active] = pair_energy(U_all[of_all.active], of_all.p.reshape(-1, *shape[1:]), harmonics)
    friction = float(contact_work(U_all[used.active], used.p.reshape(-1, *shape[1:]), harmonics).sum())
    point = Point(
        omega=omega, response=harmonics.carry(receptance.output_motion(model, level, omega, p), recorded),
        U=harmonics.carry(U_all, recorded), p=harmonics.carry(p.reshape(shape), recorded),
        energy=energy, state=state, unknowns=selection.unknowns(selected, moves, model.n_modes, model.N_H),
        newton=found.newton, krylov=found.krylov, friction=friction,
        damping=damping_loss(model, level, omega, p), input=input_work(model, level, omega, p), seconds=0.0,
        harmonics=harmonics.highest, samples=problem.n_samples, asked=asked,
        notes=() if problem.held_at is None else (HELD,),
        error=None if estimator is None else estimator.at(problem, U, found.iterate.parameter, selected),
    )
    return point, moves


def damping_loss(model: ReducedModel, level: float, omega: float, p: np.ndarray) -> float:
    """Return the viscous loss [J per cycle], the sum over harmonics of pi n^2 omega eta_n^H (phi^T C phi) eta_n.  Local."""
    n = model.harmonics.numbers
    eta = receptance.modal_motion(model, level, omega, p)
    C_eta = model.C[:, None] * eta if model.C.ndim == 1 else model.C @ eta
    return float(np.pi * omega * np.sum(n**2 * (eta.conj() * C_eta).real))


def input_work(model: ReducedModel, level: float, omega: float, p: np.ndarray) -> float:
    """Return the work of the loads [J per cycle]: closed integral of f . du over each load.  Local."""
    return float(cycle_work(level * model.f, receptance.load_motion(model, level, omega, p), model.harmonics).sum())
