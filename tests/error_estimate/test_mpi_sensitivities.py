"""Derivatives of the outputs by adjoints, compared with central differences of solutions; on any number of ranks."""

from dataclasses import replace

import numpy as np
import pytest
from dense_model import reduced
from exact_jenkins import ExactJenkins
from mpi4py import MPI
from oracles import scenes
from ring import LAW, ZETA, Sector
from scipy.optimize import brentq

from microslip.continuation.constraint_rows import Plane, Scaling
from microslip.continuation.corrector import BorderedSystem, Corrector
from microslip.continuation.iterate import Iterate
from microslip.continuation.problems import ForcedResponse
from microslip.error_estimate.estimate import output_amplitude
from microslip.error_estimate.sensitivities import exact_adjoints, sensitivities_of
from microslip.fourier.harmonics import Harmonics
from microslip.harmonic.balance import HarmonicBalance
from microslip.harmonic.operating_point import LawParameter, OperatingPoint
from microslip.points.sensitivities import COMMON, NUMBERS, of_size
from microslip.reduction.settings import ModalDamping

pytestmark = pytest.mark.ranks(1, 2)
COMM = MPI.COMM_WORLD
OMEGA, LEVEL = 555.0, 100.0


def chain(**changed):
    system = scenes.chain() | changed
    return system


def solved(equation, omega=OMEGA, level=LEVEL):
    """Return the operating point and its solution."""
    problem = ForcedResponse(equation, level)
    at = problem.at((omega,))
    guess = Iterate(equation.linear_motion(at), (omega,), equation.harmonics)
    corrector = Corrector(COMM, equation.shape, 1e-13)
    system = BorderedSystem(problem, (Plane.fixed_parameter(guess),), Scaling(1e-4, (omega,)), equation.every_pair)
    correction = corrector.correct(system, guess, is_patient=True)
    corrector.destroy()
    assert correction.failure is None, correction.failure
    return at, correction.iterate.U


def outputs(equation, omega=OMEGA, level=LEVEL):
    at, U = solved(equation, omega, level)
    p = equation.full_force(equation.contact_forces(U, equation.every_pair, tangents=False))
    return output_amplitude(equation.model_at(at), at, p)


def sensitivities(equation, omega=OMEGA, level=LEVEL):
    at, U = solved(equation, omega, level)
    solver = exact_adjoints(equation)
    derivatives = sensitivities_of(equation, at, U, equation.every_pair, solver)
    solver.destroy()
    assert derivatives.is_solved
    return derivatives


def base(system):
    model, law = reduced(system, COMM, 3)
    return HarmonicBalance.of_all(model, law, 128)


def damper():
    """Return the friction damper of Ansys' verification manual, VM320: one mass, one Jenkins element."""
    loads = [{"vector": np.array([1.0]), "harmonic": 1, "phase": 0.0}]
    settings = {"C": np.array([[7700.0]]), "loads": loads, "output": [1.0], "omega": (150.0, 300.0), "levels": {}}
    return scenes.make_system(
        "damper", [[944.6]], [[2.4e7]], [[0] + 5 * [-1]], mu=1.0, N0=246.048, k_t=2.4e7, k_n=0.0, **settings
    )


def central(f, h):
    return (f(h) - f(-h)) / (2.0 * h)


def slope(f, h=1e-4):
    """Return f'(0) by central differences of order 6."""
    return 1.5 * central(f, h) - 0.6 * central(f, 2.0 * h) + 0.1 * central(f, 3.0 * h)


@pytest.mark.parametrize("kind", ["ratio", "matrix"])
@pytest.mark.parametrize("name", ["mu", "N0", "k_t", "k_n"])
def test_derivatives_by_each_parameter_of_each_pair(name, kind):
    system = chain()
    if kind == "matrix" and "zeta" in system:
        system["C"] = 0.02 * system["M"] + 2e-5 * system["K"]
        del system["zeta"]
    equation = base(system)
    derivatives = sensitivities(equation).of_pairs[:, NUMBERS.index(name)]
    for pair in range(2):
        column = system[name][pair]
        vary = LawParameter(name, np.array([pair]), np.array([column]))

        def at(h, vary=vary):
            return outputs(equation.under(OperatingPoint(OMEGA, LEVEL, law=((vary, 1.0 + h),))))

        slope = central(at, 5e-5) / column
        assert derivatives[:, pair] == pytest.approx(slope, abs=1e-5 * np.abs(slope).max())


def test_derivatives_by_level_damping_and_frequency():
    system = chain()
    equation = base(system)
    derivatives = sensitivities(equation).common
    by_level = central(lambda h: outputs(equation, level=LEVEL * (1 + h)), 1e-5) / LEVEL
    by_omega = central(lambda h: outputs(equation, omega=OMEGA * (1 + h)), 1e-6) / OMEGA
    by_damping = central(lambda h: outputs(base(system | {"zeta": system["zeta"] * (1 + h)})), 1e-5)
    for column, slope in zip(derivatives.T, (by_level, by_damping, by_omega)):
        assert column == pytest.approx(slope, abs=1e-5 * np.abs(slope).max())
    assert len(COMMON) == 3


def size_of_damper(limit=246.048, k_t=2.4e7, level=123.024, c=7700.0, omega=200.0):
    """Return the amplitude of Ansys' friction damper, VM320, with one harmonic: docs/validation.md."""
    d, m, k = limit / k_t, 944.6, 2.4e7

    def imbalance(X):
        th = np.arccos(1.0 - 2.0 * d / X)
        a1, b1 = k_t * X / np.pi * (th - np.sin(2.0 * th) / 2.0), 4.0 * limit / np.pi * (1.0 - d / X)
        return (k + a1 / X - m * omega**2) ** 2 * X * X + (c * omega * X + b1) ** 2 - level**2

    return brentq(imbalance, d * (1.0 + 1e-12), 1e-3, xtol=1e-22, rtol=1e-15)


def test_derivatives_of_the_friction_damper_of_vm320_are_those_of_its_closed_form():
    """The derivatives by limit, k_t, level and damping: exact with exact coefficients, first order with samples."""
    exact = {name: slope(lambda h, v=v, name=name: size_of_damper(**{name: v * (1.0 + h)})) / v
             for name, v in {"limit": 246.048, "k_t": 2.4e7, "level": 123.024, "c": 7700.0, "omega": 200.0}.items()}  # fmt: skip
    errors = []
    for n_samples in (128, 1024, None):
        model, law = reduced(damper(), COMM, 1)
        if n_samples is None:
            law = ExactJenkins.of(law)
        equation = HarmonicBalance.of_all(model, law, n_samples or 128)
        at, U = solved(equation, 200.0, 123.024)
        cos, sin = output_amplitude(
            model, at, equation.full_force(equation.contact_forces(U, equation.every_pair, tangents=False))
        )
        derivatives = sensitivities(equation, 200.0, 123.024)
        rows = np.concatenate([derivatives.of_pairs[:, :, 0], derivatives.common], axis=1)
        size, _ = of_size(cos, sin, *rows)
        by = dict(zip((*NUMBERS, *COMMON), size))
        of_damper = by["mu"] / 246.048, by["k_t"], by["level"], by["damping"] / 7700.0, by["omega"]
        errors.append([abs(got / wanted - 1.0) for got, wanted in zip(of_damper, exact.values())])
    print(f"largest difference with 128 and 1024 samples and without: {[float(f'{max(each):.2g}') for each in errors]}")
    assert np.max(errors[0]) < 0.25 and np.max(errors[1]) < 0.25 / 8.0, errors  # first order in 1 / N_t
    assert np.max(errors[2]) < 1e-8, errors


@pytest.mark.parametrize("name", ["mu", "k_t", "k_n"])
def test_derivatives_on_a_sector_of_a_disc_with_complex_matrices_per_harmonic(name):
    """Parameters of the pairs of all sectors at once, including modal damping of a changed stiffness."""
    sector = Sector(COMM, 5, lambda n: n % 5)
    model = replace(sector.model(Harmonics.up_to(3)), stated_damping=ModalDamping(ratio=ZETA))
    equation = HarmonicBalance.of_all(model, sector.law, 160)
    derivatives = sensitivities(equation, 700.0, 150.0)
    for pair in range(2):
        vary = LawParameter(name, np.array([pair]), np.array(LAW[name])[[pair]])

        def at(h, vary=vary):
            return outputs(equation.under(OperatingPoint(700.0, 150.0, law=((vary, 1.0 + h),))), 700.0, 150.0)

        slope = central(at, 5e-5) / LAW[name][pair]
        assert derivatives.of_pairs[:, NUMBERS.index(name), pair] == pytest.approx(slope, abs=2e-5 * np.abs(slope).max())
    by_omega = central(lambda h: outputs(equation, 700.0 * (1.0 + h), 150.0), 1e-6) / 700.0
    assert derivatives.common[:, COMMON.index("omega")] == pytest.approx(by_omega, abs=1e-5 * np.abs(by_omega).max())
