"""A ring of N equal sectors of two masses each: modelled by one sector and its harmonic groups, and in full as a real structure.

Mass 2 of a sector is joined to mass 1 of the next by springs and a contact pair, and to the ground by another pair.  For a wave,
u_s^n = exp(i n h s alpha) u_0^n, harmonic n has the matrices K(d), R(d) of nodal diameter d = n h mod N: DESIGN.md, section 7.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from oracles.scenes import make_system

from microslip.contact.elastic_coulomb import ElasticCoulomb
from microslip.fourier.amplitudes import to_complex, to_real
from microslip.fourier.harmonics import Harmonics
from microslip.parallel.ownership import split_evenly
from microslip.receptance.damping import Damping
from microslip.receptance.modes import DampedModes
from microslip.receptance.per_group import PerGroup
from microslip.receptance.receptance import Receptance
from microslip.receptance.reduced_model import ReducedModel
from microslip.receptance.static_columns import StaticColumns
from microslip.receptance.static_response import StaticResponse
from microslip.receptance.truncated_modes import KEY, LAST, SAMPLES, DampingBeyond, EnrichedModel, of_samples

ZETA = 0.02
MASS = np.repeat([0.5, 0.3], 3)  # kg
LOAD = np.array([1.0, 0.4, 0.2, 0.0, 0.3, 0.0])
OUTPUT = np.array([0.0, 0.3, 0.0, 1.0, 0.0, 0.0])
LINK = np.diag([4.0e5, 3.0e5, 6.0e5]) + 4.0e4 * (np.ones((3, 3)) - np.eye(3))  # N/m, between the masses of a sector
NEXT = np.array([[2.0e5, 3.0e4, 0.0], [1.0e4, 1.5e5, 2.0e4], [0.0, 0.0, 2.5e5]])  # to the next sector: no mirror symmetry
LAW = {"mu": [0.3, 0.25], "N0": [60.0, 40.0], "k_t": [5.0e5, 4.0e5], "k_n": [8.0e5, 6.0e5]}
LIMIT = np.repeat(LAW["k_t"], 3)
LIMIT[2::3] = LAW["k_n"]  # K_J


def blocks():
    """Return the stiffness within a sector and to the next one, K_0 and K_1 (6, 6), without contact springs."""
    zero, ground = np.zeros((3, 3)), np.diag([1.0e5, 1.5e5, 2.0e5])
    K_0 = np.block([[LINK + ground, -LINK], [-LINK, LINK + ground]])
    # energy 1/2 (u_2 - B u_1')^T NEXT^T NEXT / c (u_2 - B u_1') of a coupling that rotates, B orthogonal
    angle = 0.4
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    spring = NEXT @ NEXT.T / 2.0e5
    K_0[3:, 3:] += spring
    K_0[:3, :3] += turn.T @ spring @ turn
    return K_0, np.block([[zero, zero], [-spring @ turn, zero]])


@dataclass(frozen=True)
class Wave:
    """The matrices of a sector for harmonics of one nodal diameter."""

    K_L: np.ndarray  # (6, 6) Hermitian
    R: np.ndarray  # (6, 6) of both pairs

    @classmethod
    def of(cls, d, N):
        turn = np.exp(2j * np.pi * d / N)
        K_0, K_1 = blocks()
        K, R = K_0 + turn * K_1 + np.conj(turn) * K_1.T, np.zeros((6, 6), dtype=complex)
        R[:3, 3:], R[:3, :3], R[3:, 3:] = np.eye(3), -turn * np.eye(3), np.eye(3)
        if (2 * d) % N == 0:
            K, R = K.real, R.real
        return cls(K + R.conj().T @ (LIMIT[:, None] * R), R)

    def modes(self):
        squares, phi = scipy.linalg.eigh(self.K_L, np.diag(MASS))
        return np.sqrt(squares), phi

    def dynamic_stiffness(self, n_omega):
        """D_n with the damping ratio of every mode."""
        omega_n, phi = self.modes()
        M = np.diag(MASS)
        C = M @ phi @ np.diag(2.0 * ZETA * omega_n) @ phi.conj().T @ M
        return self.K_L - n_omega**2 * M + 1j * n_omega * C

    def receptance(self, comm, n_modes=None):
        omega_n, phi = (each[..., :n_modes] for each in self.modes())
        R, f, o, flexibility = self.R, LOAD[:, None].astype(phi.dtype), OUTPUT[None, :], np.linalg.inv(self.K_L)
        ranges = split_evenly(2, comm.size)
        first, last = ranges[comm.rank], ranges[comm.rank + 1]

        def columns(pairs):
            return R[3 * first : 3 * last] @ flexibility @ R.reshape(2, 3, 6)[pairs].reshape(-1, 6).conj().T

        static = StaticResponse(
            G_static=StaticColumns(2, last - first, columns, is_complex=np.iscomplexobj(R)),
            du_static=R @ flexibility @ f,
            out_static=o @ flexibility @ f,
            out_R=o @ flexibility @ R.conj().T,
            load_static=f.conj().T @ flexibility @ f,
            outputs_static=(o @ flexibility @ o.T).real.ravel(),
        )
        modes = DampedModes(omega_n, Damping(2.0 * ZETA * omega_n), R @ phi, phi.conj().T @ f, o @ phi)
        return Receptance(modes, static)

    def truncated(self, receptance):
        """Return samples of the modes truncated in a receptance, by dense algebra; None if none are."""
        M, m = np.diag(MASS), len(receptance.modes.omega_n)
        if m == len(MASS):
            return None
        omega_n, phi = self.modes()
        Z = (phi[:, m:] / omega_n[m:] ** 2) @ phi[:, m:].conj().T
        last = phi[:, m - LAST : m] if m >= LAST else phi[:, :m]
        energy = (MASS @ np.abs(last) ** 2).mean()
        signs = np.random.default_rng(KEY).choice([-1.0, 1.0], (len(MASS), SAMPLES))
        samples = Z @ (np.sqrt(MASS / energy)[:, None] * signs) / np.sqrt(SAMPLES)
        rows = np.concatenate([self.R @ samples, OUTPUT[None, :] @ samples, LOAD[None, :] @ samples])
        W = Z @ M @ Z
        direct, drive = OUTPUT[None, :] @ W @ LOAD[:, None], np.array([(LOAD @ W @ LOAD).real])
        return of_samples(receptance, rows, direct, drive, DampingBeyond(ratio=ZETA), None)


class Sector:
    """A sector whose harmonic n has the nodal diameter ``diameter(n)``; ``made`` lists the diameters built."""

    def __init__(self, comm, N, diameter):
        self.comm, self.N, self.diameter, self.made = comm, N, diameter, []
        self.law = ElasticCoulomb(*(np.array(LAW[key]) for key in ("mu", "N0", "k_t", "k_n")), np.zeros(2, dtype=bool))

    def wave(self, n):
        return Wave.of(self.diameter(n), self.N)

    def _made(self, d, n_modes):
        self.made.append(d)
        return Wave.of(d, self.N).receptance(self.comm, n_modes)

    def model(self, harmonics, n_modes=None):
        """Return the reduced model; the receptance of a group is built when it is first needed."""
        diameters = tuple(range(self.N))
        f = np.zeros((1, harmonics.n_coefficients))
        f[0, harmonics.columns(1)] = 1.0, 0.0
        per_group = PerGroup(lambda d: self._made(d, n_modes), self.diameter, diameters)
        return ReducedModel(comm=self.comm, n_pairs=2, n_outputs=1, receptances=per_group, f=f, harmonics=harmonics)

    def enriched(self, model):
        """Return the enriched model, with samples of the truncated modes."""
        of_group = PerGroup(
            lambda d: Wave.of(d, self.N).truncated(model.receptances.of_group(d)), self.diameter, model.receptances.groups
        )
        return EnrichedModel(model, of_group, True)

    def physical(self, U, omega, level, harmonics, n_samples):
        """Return R u and o u of dense harmonic balance in physical coordinates, u_n = D_n^-1 (f_n - R^H p_n), as amplitudes.

        The pair forces p are those of the law for the motion with coefficients ``U``.
        """
        p = self.law.cycle(U.reshape(2, 3, -1), n_samples, tangents=False, harmonics=harmonics).p
        p_n = to_complex(p.reshape(6, -1))
        du, out = np.empty_like(p_n), np.empty(len(harmonics), dtype=complex)
        for i, n in enumerate(harmonics.chosen):
            wave = self.wave(n)
            f_n = level * LOAD if n == 1 else 0.0 * LOAD
            u_n = np.linalg.solve(wave.dynamic_stiffness(n * omega), f_n - wave.R.conj().T @ p_n[:, i])
            du[:, i], out[i] = wave.R @ u_n, OUTPUT @ u_n
        return to_real(du, U.shape[1]), out


def whole_ring(N, h):
    """Return the full ring, a system of tests/oracles/scenes.py, loaded by a travelling wave; its output is that of sector 0."""
    K_0, K_1 = blocks()
    K = np.zeros((6 * N, 6 * N))
    for s in range(N):
        this, next_one = slice(6 * s, 6 * s + 6), slice(6 * ((s + 1) % N), 6 * ((s + 1) % N) + 6)
        K[this, this] += K_0
        K[this, next_one] += K_1
        K[next_one, this] += K_1.T
    second, first = 6 * np.arange(N)[:, None] + np.arange(3, 6), 6 * np.arange(N)[:, None] + np.arange(3)
    to_next = np.hstack([second, np.roll(first, -1, axis=0)])
    to_ground = np.hstack([second, np.full((N, 3), -1)])
    pair_dofs = np.stack([to_next, to_ground], axis=1).reshape(2 * N, 6)
    loads = [
        {"vector": np.eye(N)[s].repeat(6) * np.tile(LOAD, N), "harmonic": 1, "phase": 2.0 * np.pi * h * s / N} for s in range(N)
    ]
    law = {key: np.tile(values, N) for key, values in LAW.items()}
    output = np.concatenate([OUTPUT, np.zeros(6 * N - 6)])
    M = np.diag(np.tile(MASS, N))
    return make_system("ring", M, K, pair_dofs, **law, zeta=ZETA, loads=loads, output=output, omega=(400.0, 800.0), levels={})


def amplitude(coefficients, harmonics: Harmonics, n=1):
    """Return the complex amplitude of harmonic n of coefficients (..., N_H)."""
    cos, sin = np.moveaxis(coefficients[..., harmonics.columns(n)], -1, 0)
    return cos - 1j * sin
