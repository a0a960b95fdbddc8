"""Derivatives by every parameter of a scene compared with other structures, closed forms and discs; restarted runs."""

import numpy as np
import pytest
from discs import write_sector
from matrix_scenes import write_matrix_scene
from oracles import scenes

import microslip
from microslip.continuation import acceptance
from microslip.messages.errors import Interrupted
from microslip.parallel.agree import on_root
from microslip.results.read import read_results

pytestmark = pytest.mark.ranks(1, 2)
OMEGA, STEP = 555.0, 2e-5
COLUMNS = {"friction": "mu", "preload": "N0", "tangential_stiffness": "k_t", "normal_stiffness": "k_n", "gap": "N0"}


def response_of(comm, folder, system, level, keys=(), **more):
    """Return the response of a chain at one frequency; ``more`` are keys of :func:`microslip.respond`."""

    def write():
        options = {"points": 2, "at": (OMEGA,), "harmonics": 3, "samples": 64, "error_bars": False, "tolerance": 1e-12}
        return write_matrix_scene(folder, system, [level], (OMEGA, OMEGA + 1.0), outputs=(2, 6), **options)

    with microslip.build(microslip.read(on_root(comm, write), keys), comm) as structure:
        return microslip.respond(structure, **more)


def of_requested(response, level):
    """Return the complex amplitudes of the outputs at the requested frequency, and its index."""
    of_level = response.level(level)
    (i,) = np.flatnonzero(of_level.requested)
    return of_level.response[i, :, 1] - 1j * of_level.response[i, :, 2], i


def check(table, i, key, slopes, per=1.0):
    """Compare derivatives of amplitude and phase (2, n_outputs) by a parameter with central differences."""
    of_key = table[key]
    assert np.all(slopes != 0.0)
    for values, slope in zip((of_key.amplitude[0, i], of_key.phase[0, i]), slopes):
        assert per * values == pytest.approx(slope, abs=1e-5 * np.abs(slope).max()), key


def slopes(low, high, step):
    """Return the central differences of amplitude and phase, (2, n_outputs)."""
    return np.array([np.abs(high) - np.abs(low), np.angle(high / low)]) / (2.0 * step)


def changed(system, key, factor):
    column = COLUMNS[key]
    values = np.asarray(system[column], dtype=float)
    in_question = values < 0.0 if key == "gap" else values > 0.0 if key == "preload" else np.full(len(values), True)
    return system | {column: np.where(in_question, factor * values, values)}


ON_TWO_RANKS = ("friction", "gap")  # the other parameters use the same code


@pytest.mark.parametrize(
    ("key", "N0"),
    [
        pytest.param(key, -25.0 if key == "gap" else 40.0, marks=() if key in ON_TWO_RANKS else pytest.mark.ranks(1))
        for key in COLUMNS
    ],
)
def test_derivatives_of_amplitude_and_phase_by_a_parameter_of_a_joint(comm, shared_path, key, N0):
    """All pairs of a joint at once, by a factor; also a gap that closes in each period."""
    level = 100.0 if key == "gap" else 10.0
    system = scenes.chain() | {"N0": np.array([60.0, N0])}
    response = response_of(comm, shared_path, system, level, sensitivities=True)
    (_, i), table = of_requested(response, level), response.sensitivity
    ends = [of_requested(response_of(comm, shared_path, changed(system, key, 1.0 + h), level), level)[0] for h in (-STEP, STEP)]
    check(table, i, f"joints.joint.{key}", slopes(*ends, STEP))
    if key in ("friction", "preload"):
        column = np.asarray(system[COLUMNS[key]])
        of_pairs = table[COLUMNS[key]]
        for of_joint, each in (
            (table[f"joints.joint.{key}"].amplitude, of_pairs.amplitude),
            (table[f"joints.joint.{key}"].phase, of_pairs.phase),
        ):
            assert of_joint == pytest.approx(each @ column, rel=1e-12)


@pytest.mark.ranks(1)
def test_derivatives_of_amplitude_and_phase_by_level_and_damping(comm, shared_path):
    level, system = 10.0, scenes.chain()
    response = response_of(comm, shared_path, system, level, sensitivities=True)
    (_, i), table = of_requested(response, level), response.sensitivity

    def at(factor, **which):
        f = 1.0 + factor
        other = system | {"zeta": system["zeta"] * f} if which.get("damping") else system
        at_level = level * f if which.get("level") else level
        return of_requested(response_of(comm, shared_path, other, at_level), at_level)[0]

    check(table, i, "level", slopes(at(-STEP, level=True), at(STEP, level=True), STEP), level)
    check(table, i, "damping.ratio", slopes(at(-STEP, damping=True), at(STEP, damping=True), STEP), system["zeta"])


def test_derivatives_of_one_mass_have_their_closed_form(comm, shared_path):
    """A mass on two springs, one of which is a sticking pair: points to 1e-10, and the amplitude of the peak."""
    k_t, k, m, zeta, level = 3.0e6, 1.0e6, 2.0, 0.02, 5.0
    loads = [{"vector": np.array([1.0]), "harmonic": 1, "phase": 0.0}]
    system = scenes.make_system(
        "mass", [[m]], [[k]], [[0] + 5 * [-1]], mu=1.0, N0=1e6, k_t=k_t, k_n=0.0, zeta=zeta, loads=loads, output=[1.0], omega=(1.0, 2.0), levels={}
    )  # fmt: skip
    natural = np.sqrt((k + k_t) / m)

    def write():
        options = {"points": 21, "harmonics": 1, "samples": 32, "error_bars": False, "tolerance": 1e-13}
        return write_matrix_scene(shared_path, system, [level], (0.9 * natural, 1.1 * natural), outputs=(0,), **options)

    with microslip.build(microslip.read(on_root(comm, write)), comm) as structure:
        response = microslip.respond(structure, sensitivities=True, peaks=True)
    of_level, table = response.level(level), response.sensitivity
    omega = 2.0 * np.pi * of_level.frequency
    K, n = k + k_t, len(omega)
    D = K - m * omega**2 + 2j * zeta * np.sqrt(K * m) * omega
    u = level / D
    by = {
        "joints.joint.tangential_stiffness": -u / D * (k_t + 1j * zeta * np.sqrt(m / K) * omega * k_t),  # by a factor
        "damping.ratio": -u / D * 2j * np.sqrt(K * m) * omega,
        "level": u / level,
    }
    for key, d_u in by.items():
        size, phase = (u.conj() * d_u).real / np.abs(u), (d_u / u).imag
        assert table[key].amplitude[0, :n, 0] == pytest.approx(size, abs=1e-10 * np.abs(size).max())
        assert table[key].phase[0, :n, 0] == pytest.approx(phase, abs=1e-10 * max(np.abs(phase).max(), 1.0))
    (_, rates), *_ = table.of_peaks(level)
    top = level / (K * 2.0 * zeta * np.sqrt(1.0 - zeta**2))
    assert rates["level"].amplitude == pytest.approx(top / level, rel=1e-8)
    assert rates["joints.joint.tangential_stiffness"].amplitude == pytest.approx(-top / K * k_t, rel=1e-8)
    assert rates["damping.ratio"].amplitude == pytest.approx(-top * (1 - 2 * zeta**2) / (zeta * (1 - zeta**2)), rel=1e-7)
    f_peak = natural * np.sqrt(1.0 - 2.0 * zeta**2) / (2.0 * np.pi)
    assert rates["joints.joint.tangential_stiffness"].frequency == pytest.approx(0.5 * f_peak / K * k_t, rel=1e-3)
    assert rates["damping.ratio"].frequency == pytest.approx(-2.0 * zeta * f_peak / (1.0 - 2.0 * zeta**2), rel=0.02)


DISC = """[damping]
ratio = 0.01
[response]
levels = [150.0]
frequencies = [1400.0, 1402.0]
at = [1400.0]
points = 2
[solver]
modes = 54
harmonics = 1
samples = 32
error_bars = false
tolerance = 1e-12
"""


@pytest.mark.study
@pytest.mark.ranks(1)
def test_derivatives_of_a_disc_from_one_sector(comm, shared_path):
    """[cyclic]: a parameter of a joint is that of all sectors; with all modes, so that contact stiffness changes no shapes."""
    path = on_root(comm, lambda: write_sector(shared_path, 5, DISC))

    def of(*keys, **more):
        with microslip.build(microslip.read(path, keys), comm) as structure:
            return microslip.respond(structure, **more), structure.scene

    response, scene = of(sensitivities=True)
    (_, i), table, (joint, *_) = of_requested(response, 150.0), response.sensitivity, scene.joints
    for key in ("joints.root.preload", "joints.root.tangential_stiffness"):
        value = getattr(joint, key.rsplit(".", 1)[1])
        ends = [of_requested(of(f"{key}={value * (1.0 + h)!r}")[0], 150.0)[0] for h in (-STEP, STEP)]
        check(table, i, key, slopes(*ends, STEP), value)


def test_a_stopped_run_continues_to_the_same_table(comm, shared_path, program, monkeypatch):
    def write():
        options = {"points": 10, "harmonics": 1, "samples": 32, "outputs": (6,), "error_bars": False}
        return write_matrix_scene(shared_path, scenes.chain(), [10.0], (500.0, 600.0), **options)

    path = on_root(comm, write)
    run = ("run", path, "--set", "response.sensitivities=true", "--out")
    of_point, counted, most = acceptance.with_sensitivities, [], 1000

    def stopped(*arguments):
        if len(counted) >= most:
            raise Interrupted("stopped by a test")
        counted.append(1)
        return of_point(*arguments)

    monkeypatch.setattr(acceptance, "with_sensitivities", stopped)
    assert program(*run, shared_path / "whole")[0] == 0
    n = len(counted)

    most = n + n // 2
    assert program(*run, shared_path / "parts")[0] != 0
    most = 1000
    assert program(*run, shared_path / "parts")[0] == 0
    assert len(counted) <= 2 * n + 1  # stored derivatives are not computed again
    whole, parts = (read_results(str(shared_path / name / "results.h5")).levels[0] for name in ("whole", "parts"))
    for name in ("d_by_pairs", "d_by_common"):
        values = getattr(whole, name)
        assert getattr(parts, name) == pytest.approx(values, rel=1e-8, abs=1e-12 * np.abs(values).max())
    tables = [(shared_path / name / "sensitivities.csv").read_text().splitlines() for name in ("whole", "parts")]
    assert len(tables[0]) == len(tables[1]) > len(whole.frequency) and (tables[0] == tables[1] or comm.size > 1)
