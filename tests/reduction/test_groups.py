"""Two harmonic groups, one complex: full fields, the bound of the truncated modes, and restored structures."""

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).parents[1] / "harmonic"))

from full_results import boxes_in_contact
from ring import LOAD, MASS, OUTPUT, ZETA, Sector, Wave

from microslip.fourier.amplitudes import to_complex
from microslip.fourier.harmonics import Harmonics
from microslip.library.build import Structure
from microslip.modes.eigen import Modes
from microslip.points.band import Band
from microslip.receptance.excitation import Excitation
from microslip.receptance.modes import ProjectedModes
from microslip.receptance.motions import ActingForces
from microslip.receptance.per_group import PerGroup
from microslip.receptance.reduced_model import ReducedModel
from microslip.reduction.expand import displacements
from microslip.reduction.modal_structure import reduce_structure
from microslip.reduction.settings import ModalDamping, ReductionSettings
from microslip.reduction.stuck import Factored, OnDemand
from microslip.reduction.truncation import truncation_bound
from microslip.restart.structure_arrays import structure_of, to_arrays

pytestmark = pytest.mark.ranks(1)
COMM, N, H = MPI.COMM_SELF, 5, Harmonics.up_to(3)
DAMPING = ModalDamping(ratio=ZETA)


class DenseStuck(Structure):
    """One group by dense algebra instead of MUMPS."""

    @property
    def rows(self):
        return slice(0, len(MASS))

    def solve(self, forces_owned):
        return np.linalg.solve(self.linearised.K_L, forces_owned)


def stuck_of(d, pairs):
    wave = Wave.of(d, N)
    omega_n, phi = wave.modes()
    receptance, sparse = wave.receptance(COMM), sp.csr_matrix
    system = SimpleNamespace(R=sparse(wave.R), loads=sparse(LOAD[:, None]), outputs=sparse(OUTPUT[None]), C=None, comm=COMM)
    factored = Factored(SimpleNamespace(system=system, maps=system, K_L=wave.K_L), Modes(omega_n, phi))
    modes, statics = receptance.modes, replace(receptance.static, row_sums=np.zeros(6))
    projected = ProjectedModes(omega_n, modes.R_phi, modes.b, modes.o)
    parts = {"comm": COMM, "n_dof": 6, "pairs": pairs, "statics": statics, "projected": projected, "n_modes": 6, "n_proved": 6}
    return DenseStuck(**parts, observed=None, factored=OnDemand.of(factored), group=d, scene=None, has_mesh=False)


def structures():
    """Return the structure of harmonic 1: harmonics 1 and 3 have nodal diameter 1, the others 0."""
    law = Sector(COMM, N, lambda n: n % 2).law
    pairs = SimpleNamespace(n_pairs=2, law=law)
    made = {d: stuck_of(d, pairs) for d in (0, 1)}
    groups = PerGroup(lambda d: replace(made[d], groups=groups), lambda n: n % 2, (0, 1))
    for d in (0, 1):
        groups.of_group(d)
    return groups.of(1)


def test_fields_are_those_of_a_dense_solution_harmonic_by_harmonic():
    stuck, omega, level = structures(), 700.0, 150.0
    model = ReducedModel.of(reduce_structure(stuck, DAMPING), Excitation(((1, 0.0),), H))
    p = 30.0 * np.random.default_rng(3).standard_normal((6, H.n_coefficients))
    (u,) = displacements(stuck, model, [ActingForces(level, omega, p)])
    f_n, p_n, amplitudes = level * LOAD[:, None] * to_complex(model.f), to_complex(p), to_complex(u)
    for n in range(4):
        wave = Wave.of(n % 2, N)
        exact = np.linalg.solve(wave.dynamic_stiffness(n * omega), f_n[:, n] - wave.R.conj().T @ p_n[:, n])
        np.testing.assert_allclose(amplitudes[:, n], exact, rtol=0.0, atol=1e-12 * np.abs(amplitudes).max(), err_msg=str(n))


def settings_of(level):
    omega = Wave.of(1, N).modes()[0]
    band = Band(frequencies=(0.8 * omega[0] / (2 * np.pi), 1.1 * omega[0] / (2 * np.pi)))
    return ReductionSettings(excitation=Excitation(((1, 0.0),), H), damping=DAMPING, band=band, level=level)


def test_the_bound_of_a_group_is_that_of_its_harmonics():
    stuck, settings = structures(), settings_of(200.0)
    odd, even = (truncation_bound(stuck.per_group.of_group(d), settings) for d in (1, 0))
    omega_n, phi = Wave.of(1, N).modes()
    omegas = np.linspace(0.8, 1.1, 300) * omega_n[0]
    c = 1.0 / (omega_n**2 - omegas[:, None] ** 2 + 2j * ZETA * omega_n * omegas[:, None])
    terms, static = (OUTPUT @ phi) * (phi.conj().T @ LOAD), 1.0 / omega_n**2
    peak = np.abs((c * terms).sum(axis=1)).max()
    for n_modes in range(1, 6):
        exact = np.abs(((c - static) * terms)[:, n_modes:].sum(axis=1)).max() / peak
        assert exact <= 1.02 * odd.direct[n_modes - 1]
    assert np.all(even.direct[:-1] == 0.0) and np.all(even.joint[:-1] > 0.0)  # only the joint acts in these harmonics
    assert np.all(np.diff(odd.joint) <= 0.0) and np.all(np.diff(even.joint) <= 0.0)
    assert truncation_bound(stuck.per_group.of_group(0), settings_of(1e-3)).joint.max() == 0.0  # nothing slips


@pytest.mark.parametrize("d", (0, 1))
def test_each_group_is_stored_and_restored(d):
    """Stored separately, as the parts of a disc."""
    stuck = stuck_of(d, boxes_in_contact())
    restored = structure_of(*to_arrays(stuck), None, COMM, stuck.factored)
    is_complex = d == 1
    assert np.iscomplexobj(restored.projected.R_phi) == restored.statics.G_static.is_complex == is_complex
    assert (restored.n_modes, restored.n_proved) == (6, 6)
    for name in ("omega_n", "R_phi", "b", "o"):
        np.testing.assert_array_equal(getattr(restored.projected, name), getattr(stuck.projected, name))
    for name in ("du_static", "out_static", "out_R", "load_static", "outputs_static"):
        np.testing.assert_array_equal(getattr(restored.statics, name), getattr(stuck.statics, name))
