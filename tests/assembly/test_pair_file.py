"""Pairs of DOFs from CSV: values are read, and every fault gives one message that names file and line."""

import numpy as np
import pytest

from microslip.assembly.pair_file import COLUMNS, read_pairs
from microslip.messages.errors import CaseError

HEADER = ",".join(COLUMNS)
FIRST, SECOND = "0,1,2,3,4,5,0.3,60.0,0.0,5e5,8e5", "6,7,8,-1,-1,-1,0.25,0.0,1e-6,4e5,6e5"
N_DOF = 9


def write(folder, *lines):
    path = folder / "pairs.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_pairs_have_the_values_of_the_file(tmp_path):
    table = read_pairs(write(tmp_path, HEADER, FIRST, SECOND), N_DOF)
    assert table[0].tolist() == [0, 1, 2, 3, 4, 5, 0.3, 60.0, 0.0, 5e5, 8e5]
    assert table[1].tolist() == [6, 7, 8, -1, -1, -1, 0.25, 0.0, 1e-6, 4e5, 6e5]


def test_order_of_columns_blanks_capitals_comments_and_byte_order_mark_do_not_matter(tmp_path):
    order = np.random.default_rng(0).permutation(len(COLUMNS))
    lines = [", ".join(np.array(line.split(","))[order]) for line in (HEADER.upper(), FIRST, SECOND)]
    path = tmp_path / "pairs.csv"
    path.write_bytes(b"\xef\xbb\xbf" + "\r\n".join(["# two pairs, one open", "", *lines, "", ",,"]).encode())
    np.testing.assert_array_equal(read_pairs(path, N_DOF), read_pairs(write(tmp_path, HEADER, FIRST, SECOND), N_DOF))


@pytest.mark.parametrize(
    "lines, expected",
    [
        # the header
        ([FIRST], ", line 1: the header must name the columns " + HEADER + ": x1 is missing; y1 is missing; z1 is missing"),
        ([HEADER + ",mu", FIRST + ",1"], ": mu appears twice"),
        ([HEADER.replace(",", ";"), FIRST], ": values are separated by semicolons, not by commas"),
        (["# a comment", HEADER.replace("kn", "")], ", line 2: the header must name"),
        # numbers
        ([HEADER, FIRST, "1,2,3"], ", line 3: 3 values; 11 are needed: " + HEADER),
        ([HEADER, "", "", FIRST.replace("0.3", "O.3")], ', line 4: mu = "O.3" is not a number'),
        ([HEADER, FIRST.replace("0.3", "")], ', line 2: mu = "" is not a number'),
        ([HEADER, '"0,1'], ": not a text file of comma-separated values: unexpected end of data"),
        # DOFs
        ([HEADER, SECOND.replace("8", "9", 1)], ", line 2: z1 = 9 is not a DOF number; they go from 0 to 8, and -1 is ground"),
        ([HEADER, SECOND.replace("-1", "-2", 1)], ", line 2: x2 = -2 is not a DOF number"),
        ([HEADER, SECOND.replace("8", "1e300", 1)], ", line 2: z1 = 1e+300 is not a DOF number"),
        ([HEADER, FIRST.replace("4", "1", 1)], ", line 2: y1 and y2 are both DOF 1; the pair would join it to itself"),
        # the contact
    ],
)
def test_a_mistake_gives_one_message(tmp_path, lines, expected):
    path = write(tmp_path, *lines)
    with pytest.raises(CaseError) as caught:
        read_pairs(path, N_DOF)
    assert str(caught.value).startswith(str(path)) and expected in str(caught.value)


def test_binary_files_and_folders_are_refused(tmp_path):
    path = write(tmp_path, HEADER)
    path.write_bytes(HEADER.encode("utf-16"))
    with pytest.raises(CaseError, match="not a text file of comma-separated values"):
        read_pairs(path, N_DOF)
    with pytest.raises(CaseError, match="Is a directory"):
        read_pairs(tmp_path, N_DOF)
