"""The benchmark programs of all methods solve the same equations: all methods agree on small systems."""

import csv
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import comparison
import methods
import numpy as np
import pytest
import scipy.linalg
from box_meshes import box, joint, mesh_of, settings
from comparison import CONDENSED, REFERENCE, RUBIN, Comparison, Effort, Row
from condensed import CondensedFullSet, jacobian, solve_dense
from dense_model import forced, reduced
from matrix_scenes import write_matrix_scene
from mpi4py import MPI
from oracles import scenes
from rubin import build_rubin
from stopwatch import Stopwatch

from microslip.assembly.assemble import assemble
from microslip.continuation.grid import at_frequencies
from microslip.linear.joint_springs import linearise
from microslip.mesh.pairing import pair_contacts
from microslip.mesh.partition import distribute
from microslip.modes.eigen import lowest_modes
from microslip.points.selection import AllPairs, NonStickingPairs
from microslip.receptance.excitation import Excitation
from microslip.receptance.reduced_model import ReducedModel
from microslip.reduction.modal_structure import reduce_structure
from microslip.reduction.settings import ModalDamping
from microslip.reduction.stuck import StuckStructure, static_response

COMM = MPI.COMM_SELF


# -- the condensed full set -------------------------------------------------------------------------------------------


def chain_problem(level):
    system = scenes.chain()
    model, parameters = reduced(system, COMM, 3)
    return forced(model, parameters, 128, level), np.linspace(*system["omega"], 15)[3:10]


@pytest.mark.parametrize("level", [0.1, 10.0, 30.0])
def test_methods_agree_at_every_frequency(level):
    problem, omegas = chain_problem(level)
    points = at_frequencies(problem, AllPairs(), omegas, tolerance=1e-11).points
    checked = at_frequencies(problem, NonStickingPairs(True), omegas, tolerance=1e-11).points
    with methods.contact_counter() as watch:
        row = methods.condensed_at(problem, points, list(range(len(points))), 1e-11, watch)
    peak = max(np.abs(point.response).max() for point in points)
    assert row.failure is None and row.index == list(range(7))
    for point, other, response in zip(points, checked, row.response):
        assert response == pytest.approx(point.response, abs=1e-8 * peak)
        assert other.response == pytest.approx(point.response, abs=1e-8 * peak)
    assert set(row.unknowns) == {2 * 3 * 7} and min(row.evaluations) >= 1


def test_dense_jacobian_is_the_derivative_of_the_residual():
    problem, _ = chain_problem(30.0)
    full, omega, rng = CondensedFullSet(problem, 1e-9), 560.0, np.random.default_rng(1)
    at, equation = problem.at((omega,)), problem.equation
    U_lin, G = equation.linear_motion(at), equation.receptance(at, np.arange(2))
    G_n = np.stack(list(G.blocks()))
    U, direction = 1.3 * U_lin, rng.standard_normal(U_lin.shape)
    h = 1e-6 * np.abs(U).max()
    plus, minus = (full._evaluate(U + sign * h * direction, U_lin, G_n)[2] for sign in (1.0, -1.0))
    forces = full._evaluate(U, U_lin, G_n)[1]
    product = jacobian(G_n, forces.P, forces.active) @ direction.ravel()
    assert len(forces.active) == 2 and np.abs(product - direction.ravel()).max() > 0.1
    assert ((plus - minus) / (2 * h)).ravel() == pytest.approx(product, abs=1e-6 * np.abs(product).max())


def test_dense_solution():
    rng = np.random.default_rng(1)
    A, b = rng.standard_normal((30, 30)), rng.standard_normal(30)
    assert solve_dense(A.copy(), b) == pytest.approx(np.linalg.solve(A, b), rel=1e-10)


def test_newton_without_convergence_reports_a_failure():
    problem, _ = chain_problem(30.0)
    correction = CondensedFullSet(problem, 1e-300).correct(methods.linear_iterate(problem, 560.0), 1.0)
    assert correction.failure is not None


# -- plain Rubin ------------------------------------------------------------------------------------------------------


def two_boxes(n_modes):
    """Return a structure of two boxes with a joint between them, its scene and its reduced model."""
    groups = {
        "base": lambda x: x[:, 2] == 0.0,
        "lower_top": lambda x: (x[:, 2] == 1.0) & (np.arange(len(x)) < len(x) / 2),
        "upper_bottom": lambda x: (x[:, 2] == 1.0) & (np.arange(len(x)) >= len(x) / 2),
    }
    mesh = mesh_of(("low", "hex8", *box("hex8")), ("high", "hex8", *box("hex8", origin=(0.0, 0.0, 1.0))), groups=groups)
    case = settings(
        {"low": "low", "high": "high"},
        [("base", ["x", "y", "z"])],
        [joint(tangential_stiffness=2e11, normal_stiffness=3e11, preload=100.0)],
        [{"position": (1.0, 1.0, 1.5), "direction": (1.0, 0.4, 0.1), "harmonic": 1, "phase": 0.3}],
        [{"name": "top", "position": (0.0, 0.5, 2.0), "direction": (0.0, 1.0, 0.0)}],
    )
    scene = SimpleNamespace(loads=case.loads, damping=ModalDamping(ratio=0.02))
    pairs = pair_contacts(mesh, case.joints)
    linearised = linearise(assemble(distribute(mesh, case, COMM), mesh, pairs, case), pairs)
    structure = StuckStructure.of(linearised, pairs, static_response(linearised), lowest_modes(linearised, n_modes))
    excitation = Excitation(tuple((load.harmonic, load.phase) for load in case.loads))
    return structure, scene, ReducedModel.of(reduce_structure(structure, scene.damping), excitation)


@pytest.mark.parametrize("level", [0.05, 4.0])
def test_plain_rubin_converges_to_receptance_with_more_modes(level):
    structure, _, model = two_boxes(135)  # all modes: exact
    pairs = structure.pairs
    N0 = np.where(np.arange(9) % 2 == 0, pairs.N0, 100.0 * pairs.N0)  # every second pair supports the upper box
    problem = forced(model, replace(pairs.law, N0=N0), 64, level)
    omegas = model.omega_n[0] * np.linspace(0.96, 1.04, 5)
    points = at_frequencies(problem, AllPairs(), omegas, tolerance=1e-9).points
    assert (max(np.count_nonzero(point.state) for point in points) > 3) == (level > 1.0)
    peak, errors = max(np.abs(point.response).max() for point in points), []
    for n_modes in (6, 24):
        rubin = build_rubin(*two_boxes(n_modes)[:2])
        with methods.contact_counter() as watch:
            row = methods.rubin_at(rubin, problem, points, [1, 2, 3], 1e-9, watch)
        assert row.failure is None and set(row.unknowns) == {(n_modes + 6 * 9 + 1) * 7}
        errors.append(max(np.abs(response - points[i].response).max() for i, response in zip(row.index, row.response)) / peak)
    assert errors[1] < 0.1 * errors[0] and errors[1] < 1e-3


def test_free_bodies_of_plain_rubin_have_the_modes_of_the_joined_structure():
    structure, case, model = two_boxes(30)
    rubin = build_rubin(structure, case)
    theta, phi = scipy.linalg.eigh(rubin.M, rubin.K_L)
    omega_n, phi = 1.0 / np.sqrt(theta[:-5:-1]), phi[:, :-5:-1]
    assert omega_n == pytest.approx(model.omega_n[:4], rel=1e-5)
    C = phi.T @ rubin.C @ phi * omega_n[:, None] * omega_n  # modes normalised to M
    assert pytest.approx(np.diag(2 * 0.02 * omega_n), abs=1e-6 * omega_n[0]) == C


def test_all_modes_without_residual_flexibility_are_rejected():
    structure, case, _ = two_boxes(60)
    with pytest.raises(ValueError, match="fewer modes"):
        build_rubin(structure, case)


def test_pairs_with_a_common_node_are_rejected():
    structure, case, _ = two_boxes(6)
    structure.pairs.node1[1] = structure.pairs.node1[0]
    with pytest.raises(ValueError, match="independent"):
        build_rubin(structure, case)


# -- the table --------------------------------------------------------------------------------------------------------


def row_of(level, method, indices, milliseconds, responses, unknowns=10):
    row = Row(level, method)
    for i, response in zip(indices, responses):
        row.add(i, 100.0 + i, np.array([[0.0, response]]), Effort(1e-3 * milliseconds, 3, 2, 4, unknowns))
    return row


def all_rows():
    rows = []
    for level, n in ((1.0, 2), (5.0, 6)):
        rows += [
            row_of(level, REFERENCE, range(n), level, [1.0] * n),
            row_of(level, "adaptive", range(n), 2 * level, [1.0] * (n - 1) + [1.1]),
            row_of(level, CONDENSED, [0, n - 1], 100.0 * level, [1.0, 2.0]),
            row_of(level, RUBIN, [n - 1], 1e4 * level, [1.0]),
        ]
    return rows


def test_records_are_compared_at_common_points_and_levels_weighted_by_points():
    by_key = {(record["level_N"], record["method"]): record for record in Comparison(all_rows()).records()}
    assert by_key["1", "adaptive"]["difference_from_receptance"] == pytest.approx(0.1)
    assert by_key["5", "adaptive"]["difference_from_condensed"] == pytest.approx(0.9 / 2.0)
    assert np.isnan(by_key["5", REFERENCE]["difference_from_receptance"])
    assert by_key["5", "adaptive"]["rubin_over_this"] == pytest.approx(5e4 / 10.0)
    of_all = by_key["all", REFERENCE]
    assert of_all["cpu_ms_a_point"] == pytest.approx((2 * 1.0 + 6 * 5.0) / 8) and of_all["points_of_curve"] == 8
    assert of_all["condensed_over_this"] == pytest.approx(100.0)


def test_points_at_other_frequencies_are_not_compared():
    first, second = row_of(1.0, "a", [0, 1], 1.0, [1.0, 1.0]), row_of(1.0, "b", [0, 1], 1.0, [1.0, 3.0])
    second.omega[1] += 1e-9
    assert comparison.difference(first, second) == 0.0


def test_selected_points_cover_the_curve_and_its_peak():
    assert methods.spread(100, 4, 50) == [20, 40, 50, 79]
    assert methods.spread(5, 0, 2) == methods.spread(5, 9, 2) == [0, 1, 2, 3, 4]
    assert methods.spread(5, 1, 4) == [4]


def test_frequencies_beyond_a_fold_are_omitted():
    points = [SimpleNamespace(omega=omega) for omega in (1.0, 2.0, 1.5, 1.8, 2.5)]
    assert methods.advancing(points, 1.0) == [1.0, 2.0, 2.5]
    assert methods.advancing(points[::-1], -1.0) == [2.5, 1.8, 1.5, 1.0]


# -- time measurement -------------------------------------------------------------------------------------------------


def test_stopwatch_measures_each_function_without_its_callees_and_restores_them():
    now = 0.0

    class Work:
        def outer(self):
            nonlocal now
            self.inner()
            now += 2.0

        def inner(self):
            nonlocal now
            now += 5.0

    before = dict(vars(Work))
    with Stopwatch([(Work, "outer", "outer"), (Work, "inner", "inner")], clock=lambda: now) as watch:
        Work().outer()
    assert dict(vars(Work)) == before and watch.calls == {"outer": 1, "inner": 1}
    assert watch.seconds == {"outer": 2.0, "inner": 5.0}


def test_one_command_writes_table_numbers_and_plot(tmp_path, monkeypatch, capsys):
    system = scenes.chain()
    path = write_matrix_scene(tmp_path, system, [1.0, 10.0], system["omega"], points=12, outputs=[6], harmonics=2, samples=64)
    monkeypatch.setattr(
        "sys.argv", ["methods.py", str(path), "--dense-points", "3", "--rubin-points", "0", "--out", str(tmp_path / "out")]
    )
    rates = methods.machine.memory_bandwidth, methods.machine.matrix_product_rate
    monkeypatch.setattr(methods.machine, "memory_bandwidth", partial(rates[0], n=1000))  # a rate, of no machine
    monkeypatch.setattr(methods.machine, "matrix_product_rate", partial(rates[1], n=100))
    methods.main()
    assert "condensed full set" in capsys.readouterr().out
    with open(tmp_path / "out" / "bench_methods.csv") as file:
        records = list(csv.DictReader(file))
    assert len(records) == 3 * 6 and not any(record["failure"] for record in records)
    for record in records:
        if record["method"] in (REFERENCE, comparison.ARC):
            assert float(record["difference_from_condensed"]) < 1e-7
    assert (tmp_path / "out" / "bench_methods.md").read_text().count("| condensed full set, dense |") == 4
    assert (tmp_path / "out" / "img" / "bench_methods.png").stat().st_size > 10_000
