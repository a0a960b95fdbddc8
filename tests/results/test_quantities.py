"""A quantity of a point is declared once: arrays, cells and the tables of the guide follow from it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import h5py
import numpy as np
import pytest
from docs.guide_tables import with_tables
from synthetic_results import branch, two_flanks, write

from microslip.points.branch import QUANTITIES
from microslip.points.quantities import Column, Quantity, axis_lengths, declared, number
from microslip.results.read import read_results

GUIDE = Path(__file__).parents[2] / "docs" / "guide.md"


@dataclass(frozen=True)
class SamplePoint:
    """A point with a number, a field of outputs and an optional field."""

    size: Annotated[float, number("size_m", "m", "a length", digits=3)]
    motion: Annotated[
        np.ndarray, Quantity("motion", "outputs coefficients", "m", "m", columns=(Column("mean_m", "", lambda u: u[0]),))
    ]
    bars: Annotated[np.ndarray | None, Quantity("bars_m", "outputs", "m", "bars", columns=(Column("bar_m", ""),))] = None


SIZE, MOTION, BARS = declared(SamplePoint)
LENGTHS = axis_lengths(2, 0, 5)
POINTS = [
    SamplePoint(0.12345, np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), np.array([7.0, 8.0])),
    SamplePoint(1.0, np.ones((2, 5))),
]


def test_a_field_is_an_array_with_zeros_for_missing_harmonics():
    assert SIZE.name == "size" and SIZE.array(POINTS, LENGTHS) == pytest.approx([0.12345, 1.0])
    assert MOTION.array(POINTS, LENGTHS)[0].tolist() == [[1, 2, 3, 0, 0], [4, 5, 6, 0, 0]]
    assert MOTION.array([], LENGTHS).shape == (0, 2, 5)


def test_a_missing_field_is_none_and_an_empty_cell():
    assert BARS.optional and not MOTION.optional
    assert BARS.array(POINTS, LENGTHS) is None is BARS.array([], LENGTHS)
    assert BARS.array(POINTS[:1], LENGTHS).tolist() == [[7.0, 8.0]]
    assert BARS.cells(POINTS[0], 1) == ["8"] and BARS.cells(POINTS[1], 1) == [""]


def test_cells_are_those_of_the_output_with_the_digits_declared():
    assert SIZE.cells(POINTS[0], 1) == ["0.123"] and MOTION.cells(POINTS[0], 1) == ["4"]


def test_a_level_has_every_quantity_by_name_and_nothing_else(tmp_path):
    pairs = two_flanks(2, 1)
    (level,) = read_results(write(tmp_path, [branch(5.0, pairs, n_points=3)], pairs)).levels
    lengths = axis_lengths(1, pairs.n_pairs, 7)
    assert (
        {quantity.name for quantity in QUANTITIES} == set(level.arrays) >= {"frequency", "response", "du", "p", "error", "notes"}
    )
    for quantity in QUANTITIES:
        assert quantity.optional or getattr(level, quantity.name).shape == (3, *quantity.shape(lengths)), quantity.name
    with pytest.raises(AttributeError, match="no 'velocity'"):
        _ = level.velocity


def test_names_of_earlier_versions_are_read(tmp_path):
    pairs = two_flanks(2, 1)
    path = write(tmp_path, [branch(5.0, pairs, n_points=3)], pairs)
    now = read_results(path)
    with h5py.File(path, "r+") as file:
        (level,) = file["levels"].values()
        level.move("requested", "asked")
        file["joint"].move("open_at_rest", "apart")
        file["joint"].create_dataset("own/reference", data=np.arange(float(pairs.n_pairs)))
    earlier = read_results(path)
    np.testing.assert_array_equal(earlier.levels[0].requested, now.levels[0].requested)
    np.testing.assert_array_equal(earlier.joint.open_at_rest, now.joint.open_at_rest)
    np.testing.assert_array_equal(earlier.joint.law_columns["reference"], np.arange(float(pairs.n_pairs)))


def test_the_tables_of_the_guide_are_those_of_the_declarations():
    text = GUIDE.read_text(encoding="utf-8")
    assert with_tables(text) == text, "run python tests/docs/guide_tables.py docs/guide.md"
    assert with_tables(text.replace("| `phase_rad` |", "| `phase` |").replace("(n, n_pair, 3, 2H+1)", "(n)")) == text
