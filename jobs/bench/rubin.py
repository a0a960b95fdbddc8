"""Plain Rubin: free-interface modes and residual attachment modes, every interface DOF an unknown, dense Newton.

The baseline of the literature: nothing is condensed, and the Newton matrix of all (n_modes + 6 n_pairs + n_loads) N_H
unknowns is assembled and factored by LAPACK in every step.  The bodies are joined by the joint alone, so that the lowest
modes of the unjoined structure are those of its bodies, rigid-body modes included.  Residual flexibility is taken at a
small negative shift, -alpha M, because bodies may be free:

    A = (K + alpha M)^-1 B^T - phi (lambda + alpha)^-1 phi^T B^T,        u = phi q + A g,      w = B u,

with B the interface DOFs of both bodies in the pairs' frames, and the load.  K and M are Galerkin's, in (q, w).
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from condensed import MOST_HALVINGS, MOST_ITERATIONS, solve_dense
from petsc4py import PETSc

from microslip.fourier.amplitudes import to_complex, to_real
from microslip.linear.dense import multiply
from microslip.linear.factor import Factor
from microslip.linear.joint_springs import Linearised, joint_stiffness
from microslip.modes.eigen import lowest_modes

BATCH = 128  # attachment modes solved for together
LEAST_FLEXIBILITY = 1e-9  # smallest eigenvalue of the residual flexibility, its diagonal scaled to 1


@dataclass(frozen=True)
class RubinModel:
    """Reduced matrices in (q, w): modes, then x1 y1 z1 x2 y2 z2 of each pair in its frame, then the loads' motion."""

    K_L: np.ndarray  # (n, n) N/m with the joint's springs
    M: np.ndarray  # (n, n) kg
    C: np.ndarray  # (n, n) N s/m
    outputs: np.ndarray  # (n_outputs, n)
    n_modes: int
    n_pairs: int
    n_loads: int

    def first_of(self, pairs: np.ndarray) -> np.ndarray:
        """Return the first of the six coordinates of each of ``pairs`` (m,)."""
        return self.n_modes + 6 * np.asarray(pairs)


def build_rubin(structure, scene) -> RubinModel:
    """Reduce the bodies of a structure made of a mesh.  One rank.

    Raises
    ------
    ValueError : two pairs share a node, or a pair's node is fixed, so that 6 n_pairs DOFs are not independent; or the modes
        leave too little of the interface's flexibility over
    """
    system, n_modes = structure.linearised.system, len(structure.modes.omega_n)
    alpha = structure.modes.omega_n[0] ** 2
    B = boundary(structure)
    A = system.K.duplicate(copy=True)
    A.axpy(alpha, system.M)
    A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    A.setOption(PETSc.Mat.Option.SPD, True)
    free = Linearised(system, A, system.M, Factor(A, what="K + alpha M"))
    modes = lowest_modes(free, n_modes, verify=False)
    phi, shifted = modes.phi_owned, modes.omega_n**2  # lambda + alpha
    B_phi = B @ phi
    residual = np.empty((B.shape[1], B.shape[0]), order="F")
    for start in range(0, B.shape[0], BATCH):
        rows = slice(start, start + BATCH)
        residual[:, rows] = free.factor.solve(B[rows].T.tocsc()) - (phi / shifted) @ B_phi[rows].T
    M_aa = np.empty((B.shape[0], B.shape[0]))
    for start in range(0, B.shape[0], BATCH):  # in parts: M residual is as large as it
        rows = slice(start, start + BATCH)
        M_aa[:, rows] = residual.T @ multiply(system.M, residual[:, rows])
    F = B @ residual
    free.destroy()
    M_aa, F = 0.5 * (M_aa + M_aa.T), 0.5 * (F + F.T)
    scale = 1.0 / np.sqrt(np.diag(F))
    if scipy.linalg.eigvalsh(scale[:, None] * F * scale, subset_by_index=[0, 0])[0] < LEAST_FLEXIBILITY:
        raise ValueError(f"plain Rubin: {n_modes} modes leave no residual flexibility to some interface DOFs; take fewer modes")
    n_loads, n_pairs = system.loads.shape[1], structure.pairs.n_pairs
    to_g = np.linalg.solve(F, np.hstack([-B_phi, np.eye(len(F))]))  # g = F^-1 (w - B phi q)
    K = to_g.T @ (F - alpha * M_aa) @ to_g
    M = to_g.T @ M_aa @ to_g
    modal = np.arange(n_modes)
    K[modal, modal] += shifted - alpha
    M[modal, modal] += 1.0
    outputs = (system.outputs @ residual) @ to_g
    outputs[:, :n_modes] += system.outputs @ phi
    R = relative_motion(n_modes, n_pairs, n_loads)
    K_L = K + R.T @ (joint_stiffness(structure.pairs)[:, None] * R.toarray())
    K_L, M = 0.5 * (K_L + K_L.T), 0.5 * (M + M.T)
    return RubinModel(K_L, M, damping_matrix(scene.damping, K_L, M), outputs, n_modes, n_pairs, n_loads)


def boundary(structure) -> sp.csr_matrix:
    """Return B, (6 n_pairs + n_loads, n_dof): both bodies' motion at each pair in its frame, and along the loads."""
    pairs, system = structure.pairs, structure.linearised.system
    nodes = np.column_stack([pairs.node1, pairs.node2])
    columns = system.dof[nodes]  # (n_pairs, 2, 3)
    if len(np.unique(nodes)) < nodes.size or nodes.min() < 0 or columns.min() < 0:
        raise ValueError("plain Rubin: interface nodes are shared by pairs, fixed or ground; 6 n_pairs DOFs are not independent")
    values = np.broadcast_to(pairs.frame[:, None], (pairs.n_pairs, 2, 3, 3))
    rows = np.arange(6 * pairs.n_pairs).reshape(-1, 2, 3, 1)
    rows, columns = np.broadcast_arrays(rows, columns[:, :, None, :])
    shape = (6 * pairs.n_pairs, system.R.shape[1])
    interface = sp.csr_matrix((values.ravel(), (rows.ravel(), columns.ravel())), shape=shape)
    return sp.vstack([interface, system.loads.T], format="csr")


def relative_motion(n_modes: int, n_pairs: int, n_loads: int) -> sp.csr_matrix:
    """Return R in the reduced coordinates, (3 n_pairs, n): body 1 minus body 2."""
    of_pair = sp.hstack([sp.identity(3), -sp.identity(3)])
    whole = [sp.csr_matrix((3 * n_pairs, n_modes)), sp.kron(sp.identity(n_pairs), of_pair), sp.csr_matrix((3 * n_pairs, n_loads))]
    return sp.hstack(whole, format="csr")


def damping_matrix(damping, K_L: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Return C: of every mode of (K_L, M) the scene's ratio, or Rayleigh's.

    With theta = 1 / omega^2 and modes normalised to K_L, C = K_L phi 2 zeta theta^(1/2) phi^T K_L: defined for modes
    without mass, too.
    """
    if damping.ratio is None:
        return damping.rayleigh[0] * M + damping.rayleigh[1] * K_L
    theta, phi = scipy.linalg.eigh(M, K_L)
    K_phi = K_L @ phi
    return (K_phi * (2.0 * damping.ratio * np.sqrt(np.maximum(theta, 0.0)))) @ K_phi.T


class PlainRubin:
    """Newton with all unknowns and a dense matrix, at fixed frequencies.  One rank.

    ``problem`` evaluates the contact: the same kernel, parameters and samples as every other method.  The residual is
    measured as theirs, by the relative motion that it causes, Z^-1 r: so a tolerance means the same and a step is halved
    alike.  A program of this kind would do without; ``seconds_of_measure`` says what it took, to be left out of its time.
    """

    def __init__(self, rubin: RubinModel, problem, tolerance: float):
        self.rubin, self.equation, self.tolerance = rubin, problem.equation, tolerance
        self.R = relative_motion(rubin.n_modes, rubin.n_pairs, rubin.n_loads)
        model = self.equation.model
        self.f = np.zeros((len(rubin.M), model.N_H))
        self.f[len(self.f) - rubin.n_loads :] = problem.level * model.f  # w of the loads is their motion
        self.seconds_of_measure = 0.0  # processor time

    @property
    def unknowns(self) -> int:
        return self.f.size

    def dynamic_stiffness(self, omega: float) -> np.ndarray:
        """Return Z_n = K_L - (n omega)^2 M + i n omega C, (H + 1, n, n) complex."""
        n_omega = omega * np.arange(self.equation.model.N_H // 2 + 1)[:, None, None]
        return self.rubin.K_L - n_omega**2 * self.rubin.M + 1j * n_omega * self.rubin.C

    def motion_under(self, p: np.ndarray, omega: float) -> np.ndarray:
        """Return the coordinates (n, N_H) under the loads and given contact forces ``p`` (3 n_pairs, N_H) [N]."""
        return Measure(self, self.dynamic_stiffness(omega)).motion(self.f - self.R.T @ p)

    def correct(self, x: np.ndarray, omega: float, size: float) -> tuple[np.ndarray, int, str | None]:
        """Return the coordinates at ``omega``, Newton iterations and what failed; |r| <= tolerance x size is accepted [m]."""
        Z = self.dynamic_stiffness(omega)
        measure = self._measured(Measure, self, Z)
        x, forces, r = self._evaluate(x, Z)
        norm = self._measured(measure.of, r)
        for iteration in range(MOST_ITERATIONS):
            if norm <= self.tolerance * size:
                return x, iteration, None
            step = solve_dense(self._jacobian(Z, forces), -r.ravel()).reshape(x.shape)
            for _ in range(MOST_HALVINGS):
                trial = self._evaluate(x + step, Z)
                new = self._measured(measure.of, trial[2])
                if new < norm:
                    break
                step = 0.5 * step
            (x, forces, r), norm = trial, new
        return x, MOST_ITERATIONS, f"{MOST_ITERATIONS} iterations, residual {norm / size:.1e} (bound {self.tolerance:.1e})"

    def _measured(self, call, *args):
        start = time.process_time()
        result = call(*args)
        self.seconds_of_measure += time.process_time() - start
        return result

    def _evaluate(self, x: np.ndarray, Z: np.ndarray):
        """Return x, the contact forces and the residual Z x + R^T p - f, (n, N_H) [N]."""
        equation = self.equation
        forces = equation.contact_forces((self.R @ x).reshape(equation.shape), equation.every_pair, tangents=True)
        Z_x = to_real(np.matmul(Z, to_complex(x).T[:, :, None])[:, :, 0].T, x.shape[1])
        return x, forces, Z_x + self.R.T @ equation.full_force(forces) - self.f

    def _jacobian(self, Z: np.ndarray, forces) -> np.ndarray:
        """Return Z + R^T P R, (n N_H, n N_H), rows and columns ordered as x (n, N_H)."""
        n, N_H = self.f.shape
        J = np.zeros((n, N_H, n, N_H))
        J[:, 0, :, 0] = Z[0].real
        for k in range(1, len(Z)):
            c, s = 2 * k - 1, 2 * k
            J[:, c, :, c] = J[:, s, :, s] = Z[k].real
            J[:, c, :, s], J[:, s, :, c] = Z[k].imag, -Z[k].imag
        for first, P in zip(self.rubin.first_of(forces.active), forces.P.reshape(-1, 3, N_H, 3, N_H)):
            body_1, body_2 = slice(first, first + 3), slice(first + 3, first + 6)
            J[body_1, :, body_1] += P
            J[body_2, :, body_2] += P
            J[body_1, :, body_2] -= P
            J[body_2, :, body_1] -= P
        return J.reshape(n * N_H, n * N_H)


class Measure:
    """Factors of Z_n at one frequency."""

    def __init__(self, rubin: PlainRubin, Z: np.ndarray):
        self.R, self.factors = rubin.R, [scipy.linalg.lu_factor(Z_n) for Z_n in Z]

    def motion(self, force: np.ndarray) -> np.ndarray:
        """Return Z^-1 force, (n, N_H) both."""
        amplitudes = to_complex(force)
        motion = np.column_stack([scipy.linalg.lu_solve(lu, column) for lu, column in zip(self.factors, amplitudes.T)])
        return to_real(motion, force.shape[1])

    def of(self, r: np.ndarray) -> float:
        """Return the size of the relative motion that a residual force causes [m]."""
        return float(np.linalg.norm(self.R @ self.motion(r)))
