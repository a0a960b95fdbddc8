"""Faults of the catalogue in processes of their own: some of them here, all of them with CATALOGUE=all in the environment."""

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
@pytest.mark.parametrize("case", [pytest.param(one, id=one.name) for one in FAULTS if ALL or one.name in SOME])
def test_a_fault(tmp_path, sound, case, ranks):
    ended, wrong = processes.fault(case, sound, tmp_path / "here", ranks)
    assert not wrong, ended.said


def test_the_faults_are_as_many_as_they_say():
    names = [one.name for one in FAULTS]
    assert len(set(names)) == len(names) >= 50 and set(SOME) <= set(names)
