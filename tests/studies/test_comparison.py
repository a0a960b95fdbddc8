"""The figures of a comparison, its table and its files."""

import csv
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from microslip.results.measures import MEAN, shown_with
from microslip.studies.compare.report import Row, differences, energy_difference, numbers, table, write_comparison

OMEGAS = 2 * np.pi * np.array([10.0, 11.0, 12.0])
SCENE = SimpleNamespace(title="A scene")


def row(method, amplitudes, friction=(0.0, 2.0, 0.0), level=1.0, failure=None):
    points = [
        SimpleNamespace(
            omega=w, response=np.array([[0.0, a, 0.0], [0.0, 0.0, 10.0 * a]]), friction=e, unknowns=6 + k, newton=k, seconds=0.01
        )
        for k, (w, a, e) in enumerate(zip(OMEGAS, amplitudes, friction))
    ]
    return Row(level, method, 0.5, points, failure)


EXACT = row("full", (1.0, 4.0, 2.0))


def test_differences_are_relative_to_the_peak_of_each_output():
    assert differences(row("rubin", (1.0, 4.4, 2.0)), EXACT) == pytest.approx([0.0, 0.1, 0.0])
    assert energy_difference(row("rubin", (1.0, 4.0, 2.0), (0.1, 2.0, 0.0)), EXACT) == pytest.approx(0.05)
    assert np.isnan(energy_difference(EXACT, row("full", (1.0, 4.0, 2.0), (0.0, 0.0, 0.0))))


def test_a_record_has_peak_unknowns_and_effort():
    computed = numbers(row("rubin", (1.0, 4.4, 2.0)), EXACT)
    assert (computed["peak_m"], computed["peak_Hz"]) == pytest.approx((4.4, 11.0))
    assert (computed["unknowns_min"], computed["unknowns_max"], computed["evaluations"], computed["points"]) == (6, 8, 3, 3)
    assert computed["ms_a_point"] == pytest.approx(10.0)
    assert computed["difference_percent"] == pytest.approx(10.0)


def test_a_method_that_ends_early_is_compared_where_it_has_points():
    computed = numbers(row("rubin", (1.0, 4.4), failure="no convergence"), EXACT)
    assert (computed["points"], computed["failure"]) == (2, "no convergence")
    nothing = numbers(Row(1.0, "rubin", 0.5, [], "no convergence"), EXACT)
    assert nothing["points"] == 0 and np.isnan(nothing["difference_percent"])
    assert "no convergence" in table([numbers(EXACT, EXACT), nothing], EXACT)


def test_the_displacement_of_statics_is_listed():
    def still(method, mean):
        points = [
            SimpleNamespace(omega=1.0, response=np.array([[mean, 0.0, 0.0]]), friction=0.0, unknowns=6, newton=2, seconds=0.01)
        ]
        return Row(1.0, method, 0.5, points, None, MEAN)

    row = numbers(still("rubin", -2.2e-6), still("full", -2e-6))
    assert (row["peak_m"], row["difference_percent"]) == pytest.approx((-2.2e-6, 10.0))
    assert "-2.2e-06" in table([row], still("full", -2e-6))


def test_the_unit_of_the_output_is_listed():
    shown = replace(EXACT, shown=shown_with(3, "m/s2", "1"))
    row = numbers(shown, shown)
    assert list(row)[-1] == "unit" and row["unit"] == "m/s2" and numbers(replace(shown, points=[]), shown)["unit"] == "m/s2"
    assert "peak" in table([row], shown) and "m/s2" in table([row], shown)


def test_the_files_have_every_row(tmp_path):
    rows = [
        EXACT,
        row("full", (2.0, 8.0, 4.0), level=2.0),
        row("rubin", (1.0, 4.4, 2.0)),
        row("rubin", (2.0, 8.0, 4.0), level=2.0),
    ]
    text = write_comparison(rows, SCENE, str(tmp_path / "new"))
    assert text.count("reference") >= 2 and text.count("rubin") == 2
    with open(tmp_path / "new" / "compare.csv", newline="") as file:
        entries = list(csv.DictReader(file))
    assert [(float(entry["level_N"]), entry["method"]) for entry in entries] == [
        (1, "full"),
        (1, "rubin"),
        (2, "full"),
        (2, "rubin"),
    ]
    assert float(entries[1]["difference_percent"]) == pytest.approx(10.0)
    assert (tmp_path / "new" / "compare.png").stat().st_size > 10_000
