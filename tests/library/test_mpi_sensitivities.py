"""Sensitivities of responses: files, joints against pairs, peaks and scatter; every test runs on any number of ranks."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from matrix_scenes import write_matrix_scene
from oracles import exact, scenes
from scipy.optimize import minimize_scalar

import microslip
from microslip.messages.errors import CaseError
from microslip.parallel.agree import on_root
from microslip.results.read import read_results
from microslip.results.record import StaticTable
from microslip.results.report.tables import sensitivities_table
from microslip.results.sensitivities import relative_at_peak

pytestmark = pytest.mark.ranks(1, 2)
FRICTION, RATIO = "joints.joint.friction", "damping.ratio"


@pytest.fixture(scope="module")
def path(comm, tmp_path_factory):
    folder = comm.bcast(tmp_path_factory.mktemp("sensitivities"))
    levels, frequencies = [10.0], (400.0, 600.0)
    options = {"points": 16, "at": (555.0,), "harmonics": 3, "outputs": (6,), "error_bars": False, "tolerance": 1e-11}
    return on_root(comm, lambda: write_matrix_scene(folder, scenes.chain(), levels, frequencies, **options))


@pytest.fixture(scope="module")
def structure(comm, path):
    with microslip.build(microslip.read(path), comm) as built:
        yield built


@pytest.fixture(scope="module")
def response(structure):
    return microslip.respond(structure, sensitivities=True, peaks=True)


@pytest.mark.ranks(1)
def test_derivatives_by_a_joint_are_sums_over_its_pairs_and_agree_with_differences(structure, response):
    table = response.sensitivity
    mu = np.unique(structure.pairs.mu)
    of_pairs = (table["mu"].amplitude * structure.pairs.mu).sum(axis=-1)
    assert table[FRICTION].amplitude == pytest.approx(of_pairs, rel=1e-9, nan_ok=True)
    (i,) = np.flatnonzero(response.level(10.0).requested)

    def amplitude(factor):
        other = microslip.respond(structure, friction={"joint": factor * structure.pairs.mu})
        (k,) = np.flatnonzero(other.level(10.0).requested)
        return np.hypot(*other.level(10.0).response[k, :, 1:3].T)

    h = 1e-4
    slope = (amplitude(1.0 + h) - amplitude(1.0 - h)) / (2.0 * h)
    assert table[FRICTION].amplitude[0, i] == pytest.approx(slope, abs=1e-5 * np.abs(slope).max())
    assert len(mu) and RATIO in table and "level" in table and "joints.joint.normal_stiffness" in table


@pytest.mark.ranks(1)
def test_frequency_and_phase_of_a_peak_follow_the_closed_form(tmp_path):
    """One mass on a Jenkins element, one harmonic, many samples: derivatives of its closed form by damping and friction."""
    level, zeta = 0.8, 0.01
    load = {"vector": [1.0], "harmonic": 1}
    system = scenes.make_system(
        "mass", [[1.0]], [[1.0]], [[0, -1, -1, -1, -1, -1]],
        mu=1.0, N0=1.0, k_t=1.0, k_n=0.0, zeta=zeta, loads=[load], output=[1.0], omega=(0.5, 2.0), levels={},
    )  # fmt: skip

    def exact_peak(ratio, limit):
        c = 2.0 * np.sqrt(2.0) * ratio
        X = exact.jenkins_peak(level, limit, c)
        a, b, _ = exact.jenkins_harmonic(X, 1.0, limit)

        def dynamic(w):
            return (1.0 + a / X - w * w) * X, c * w * X + b

        w = minimize_scalar(lambda w: np.hypot(*dynamic(w)), bounds=(0.9, 1.5), method="bounded", options={"xatol": 1e-12}).x
        return np.array([w / (2.0 * np.pi), -np.arctan2(*dynamic(w)[::-1])])

    path = write_matrix_scene(tmp_path, system, [level], (0.5, 2.0), points=40, harmonics=1, samples=4096, error_bars=False)
    with microslip.build(microslip.read(path)) as one_mass:
        of = microslip.respond(one_mass, sensitivities=True, peaks=True, tolerance=1e-12)
    ((_, rates),) = of.sensitivity.of_peaks(level)
    h = 1e-2
    for key, ends in (
        (RATIO, [exact_peak(zeta * (1.0 + way), 1.0) / zeta for way in (-h, h)]),
        (FRICTION, [exact_peak(zeta, 1.0 + way) for way in (-h, h)]),
    ):
        by_frequency, by_phase = (ends[1] - ends[0]) / (2.0 * h)
        assert rates[key].frequency == pytest.approx(by_frequency, rel=3e-3)
        assert rates[key].phase == pytest.approx(by_phase, abs=2e-3 * by_frequency * 40.0)  # the phase changes by 40 rad per Hz


@pytest.mark.ranks(1)
def test_derivatives_of_peaks_by_the_level_agree_with_differences(structure):
    """The frequency of a peak depends on the sample at which slip ends; many samples reduce this error."""
    of = microslip.respond(structure, sensitivities=True, peaks=True, samples=512)
    (peak, rates), *_ = of.sensitivity.of_peaks(10.0)
    near = [microslip.respond(structure, levels=[level], peaks=True, samples=512).peaks[level][0] for level in (9.8, 10.2)]
    by_size, by_frequency = (np.subtract(*reversed(pair)) / 0.4 for pair in zip(*((abs(p.amplitude), p.omega) for p in near)))
    assert rates["level"].amplitude == pytest.approx(by_size, rel=5e-3)
    assert rates["level"].frequency == pytest.approx(by_frequency / (2.0 * np.pi), rel=0.05)
    assert peak.by_pairs.shape == (3, 5, 2)
    results = of.sensitivity.results
    frequency, of_pairs, by_damping = relative_at_peak(results.joint, results.levels[0])
    assert 2.0 * np.pi * frequency == pytest.approx(peak.omega)
    for each, key in ((of_pairs["mu"].sum(), FRICTION), (by_damping, RATIO)):
        assert each == pytest.approx(rates[key].amplitude * of.sensitivity.varied[key].value / abs(peak.amplitude), rel=1e-9)


def test_the_report_without_peaks_has_relative_changes_of_the_largest_point(response):
    table, results = response.sensitivity, response.sensitivity.results
    results = replace(results, levels=tuple(replace(level, peaks=None) for level in results.levels))
    size = np.hypot(*results.levels[0].response[:, 0, 1:3].T)
    at, ratio = int(np.argmax(size)), table.varied[RATIO].value
    text = sensitivities_table(results)
    for rate, value in ((table["mu"].amplitude[0, at, 0], results.joint.mu), (table[RATIO].amplitude[0, at, 0], ratio)):
        assert f"<td>{np.sum(rate * value) / size[at]:+.2g} %</td>" in text
    assert sensitivities_table(replace(results, levels=())) == "" and "state of rest" not in text
    at_rest = {"joints": StaticTable((), {})}
    assert "The state of rest stays as it is." in sensitivities_table(replace(results, at_rest=at_rest))


def test_scatter_is_the_root_of_the_sum_of_squares(response):
    table, level = response.sensitivity, 10.0
    scatter = table.scatter({FRICTION: 10.0, "level": 5.0})
    parts = [0.1 * table[FRICTION].amplitude, 0.05 * level * table["level"].amplitude]
    assert scatter.amplitude == pytest.approx(np.hypot(*parts), nan_ok=True)
    assert len(scatter.peaks[level]) == len([rates for _, rates in table.of_peaks(level) if rates])
    for wrong, text in (({"joints.joint.fricton": 1.0}, "friction"), ({"level": -1.0}, "at least 0")):
        with pytest.raises(CaseError, match=text):
            table.scatter(wrong)


def test_sensitivities_that_were_not_requested_are_rejected(structure, response):
    with pytest.raises(CaseError, match="sensitivities=True"):
        microslip.respond(structure, points=4).sensitivity["mu"]  # noqa: B018
    with pytest.raises(CaseError, match="no number"):
        response.sensitivity["m"]  # noqa: B018


def test_a_run_writes_sensitivities(comm, path, program, shared_path):
    keys = [part for key in ("sensitivities", "peaks") for part in ("--set", f"response.{key}=true")]
    status, _, err = program("run", path, "--out", shared_path / "out", *keys)
    assert status == 0, err
    results = read_results(str(shared_path / "out" / "results.h5"))
    (level,) = results.levels
    assert level.d_by_pairs.shape == (len(level.frequency), 1, 2, 5, 2) and level.peaks[0].by_common.shape == (3, 3)
    with open(shared_path / "out" / "sensitivities.csv") as file:
        rows = list(csv.DictReader(file))
    assert {row["of"] for row in rows} == {"point", "peak"} and {row["parameter"] for row in rows} >= {FRICTION, "level"}
    first = next(row for row in rows if row["parameter"] == "level" and row["output"] == "6")
    assert float(first["relative"]) == pytest.approx(10.0 * float(first["d_amplitude"]) / float(first["amplitude_m"]), rel=1e-4)
