"""Helpers for large files: positions of node numbers, groups of nodes with the same supports, line numbers of commands."""

import numpy as np
import pytest
from plain_model import cdb, plain

from microslip.formats.ansys.commands import commands
from microslip.formats.model import fixed_alike, index_of


@pytest.mark.parametrize("highest", [40, 400, 10**12])  # few holes, many, too many for a table
@pytest.mark.parametrize("is_rising", [False, True])
@pytest.mark.parametrize("n_wanted", [3, 500])
def test_numbers_are_located_and_missing_ones_returned(highest, is_rising, n_wanted):
    rng = np.random.default_rng(7)
    numbers = rng.permutation(np.unique(rng.integers(-5, highest, 30)))
    numbers = np.sort(numbers) if is_rising else np.append(numbers, numbers[:2])  # the first of repeated numbers holds
    place = {int(number): i for i, number in reversed(list(enumerate(numbers)))}
    wanted = np.concatenate([rng.choice(numbers, n_wanted), [-(2**62), numbers.max() + 1]])
    index, missing = index_of(numbers, wanted)
    assert missing.tolist() == [-(2**62), numbers.max() + 1]
    assert index[:-2].tolist() == [place[int(number)] for number in wanted[:-2]]


def test_wanted_numbers_may_be_fractional_or_empty():
    index, missing = index_of(np.array([4, 2, 7]), np.array([7.0, 2.5, 4.0]))
    assert index[[0, 2]].tolist() == [2, 0] and missing.tolist() == [2.5]
    assert len(index_of(np.array([4, 2, 7]), np.array([]))[1]) == 0
    assert index_of(np.array([], dtype=np.int64), np.array([3]))[1].tolist() == [3]


def test_nodes_are_grouped_by_their_supported_axes():
    fixed = np.array([[1, 1, 1], [0, 0, 0], [0, 0, 1], [1, 1, 1], [1, 0, 1]], dtype=bool)
    groups = [(axes, nodes.tolist()) for axes, nodes in fixed_alike(fixed)]
    assert groups == [((2,), [2]), ((0, 2), [4]), ((0, 1, 2), [0, 3])]


def test_commands_of_an_archive_have_their_line_numbers(tmp_path):
    path = tmp_path / "model.cdb"
    text = cdb(plain(), ("RLBLOCK,1,1,6,7", "(2i8,6g16.9)", "(7g16.9)", "       1       1  1.0", "MP,EX,9,1.0$MP,NUXY,9,0.3"))
    path.write_bytes(text.replace("\n", "\r\n").encode())
    lines = text.split("\n")
    in_order = list(commands(str(path)))
    for command in in_order:
        assert command.word in lines[command.line - 1].upper()
    assert [command.word for command in in_order] == [
        part.split(",")[0].upper() for line in lines if line and line.strip()[0] not in "(-0123456789" for part in line.split("$")
    ]
