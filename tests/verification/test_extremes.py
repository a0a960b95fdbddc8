"""A few cases of every family of the battery of extremes (extremes.py): each is solved or fails with a message."""

import dataclasses

import numpy as np
import pytest
from oracles import point_check
from verification import extreme_structures
from verification.extreme_cases import Case, all_cases, quick_cases
from verification.extreme_run import SOLVED, run_case, solved

# two small cases per family and the delicate ones; `make studies` runs four per family
FEW = quick_cases(slice(1, None, 2))
NAMES = {case.name for case in FEW}
MORE = [pytest.param(case, marks=pytest.mark.study) for case in quick_cases() if case.name not in NAMES]


def name_of(case):
    return f"{case.family}: {case.name}"


def test_the_battery_has_300_cases():
    assert len(all_cases()) >= 300


@pytest.mark.parametrize("case", [*FEW, *MORE], ids=name_of)
def test_each_case_is_solved_or_rejected_as_expected(case):
    outcome = run_case(case)
    assert outcome.status == SOLVED or outcome.expected, f"{outcome.status}: {outcome.words}"


def test_the_check_detects_wrong_points(tmp_path):
    """A change of 1e-4 in each part of a point is detected."""
    system = extreme_structures.chain()
    case = Case("", "", extreme_structures.chain)
    (branch,) = solved(tmp_path, system, [1.0], (0.3, 0.7), (), case)
    point = max(branch.points, key=lambda point: np.abs(point.U).max())
    judge, outputs = point_check.Judge(system, 3, 128), range(9)
    assert not judge.verdict(point, 1.0, outputs).faults() and (point.state != 0).any()
    for name in ("U", "p", "response", "input", "damping", "friction"):
        changed = dataclasses.replace(point, **{name: (1.0 + 1e-4) * getattr(point, name)})
        assert judge.verdict(changed, 1.0, outputs).faults(), name
    wrong_state = dataclasses.replace(point, state=(point.state + 1) % 3)
    assert judge.verdict(wrong_state, 1.0, outputs).faults() == ["states differ from those of the march"]
    assert judge.verdict(dataclasses.replace(point, omega=point.omega * 1.0001), 1.0, outputs).faults()
    assert judge.verdict(dataclasses.replace(point, U=point.U * np.nan), 1.0, outputs).faults()
    assert judge.verdict(point, 1.0001, outputs).faults()
