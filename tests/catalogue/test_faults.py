"""Faults of the catalogue in separate processes: two by default, all with CATALOGUE=all in the environment."""

import os

import pytest

from catalogue import processes
from catalogue.faults import FAULTS
from catalogue.sound import write_sound

ALL = os.environ.get("CATALOGUE") == "all"
SOME = ("kill while file 1 is written", "defect on the last rank in 'matrices'")  # a segfault: tests/cli/test_one_rank_fails.py


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sound")
    write_sound(folder)
    return folder


@pytest.mark.slow
@pytest.mark.ranks(1)
@pytest.mark.parametrize("ranks", [1, 2] if ALL else [2])
@pytest.mark.parametrize("case", [pytest.param(fault, id=fault.name) for fault in FAULTS if ALL or fault.name in SOME])
def test_a_fault_has_the_expected_outcome(tmp_path, sound, case, ranks):
    ended, wrong = processes.fault(case, sound, tmp_path / "here", ranks)
    assert not wrong, ended.stderr


def test_the_catalogue_has_at_least_50_distinct_faults():
    names = [fault.name for fault in FAULTS]
    assert len(set(names)) == len(names) >= 50 and set(SOME) <= set(names)
