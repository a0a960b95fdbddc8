"""Values as bytes: restored exactly, and a wrong byte causes at most an error."""

import io

import numpy as np
import pytest
import sandboxed
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays, integer_dtypes

from microslip.system.plain_data import Unreadable, read, write

ATOMS = st.none() | st.booleans() | st.integers() | st.floats() | st.text() | arrays(integer_dtypes(), array_shapes(min_side=0))
KEYS = st.integers() | st.text()
VALUES = st.recursive(ATOMS, lambda one: st.lists(one) | st.lists(one).map(tuple) | st.dictionaries(KEYS, one), max_leaves=20)


def written(value):
    file = io.BytesIO()
    write(file, value)
    return file.getvalue()


def back(content, **limits):
    return read(io.BytesIO(content), (sandboxed.Answer,), **limits)


@given(VALUES)
def test_values_are_restored(value):
    np.testing.assert_equal(back(written(value)), value)


def test_every_wrong_byte_and_every_end_is_an_error_or_another_value():
    content = written(sandboxed.answer())
    for i in range(len(content)):
        with pytest.raises(Unreadable):
            back(content[:i])
        for change in (1, 32, 255):
            try:
                back(content[:i] + bytes([content[i] ^ change]) + content[i + 1 :])
            except Unreadable:
                pass


@pytest.mark.parametrize(
    "content",
    [
        b'99\n[["array", 0], [["<f8", [1000000000000]]]]',
        b'40\n[["array", 0], [["|O", [1]]]]             12345678',
        b'40\n[["array", 0], [["<f8", [-1]]]]           12345678',
        b'40\n[["array", 0], [[[["a", "O"]], [1]]]]     12345678',
        b'40\n[["object", "Path", {}], []]              ',
        b"7\n[[[], []]]",
        b"100000\n" + b"[" * 100000,
        b"12345678901234567890\n",
    ],
)
def test_foreign_bytes_are_rejected(content):
    with pytest.raises(Unreadable):
        back(content)


def test_sparse_matrices_with_indices_out_of_range_are_rejected():
    value = sandboxed.answer().matrix
    value.indices[0] = 7
    with pytest.raises(Unreadable, match="ValueError"):
        back(written(value))


def test_values_beyond_the_memory_limit_are_rejected():
    content = written([np.zeros(1000), np.zeros(1000)])
    assert len(back(content, most=20000)) == 2
    with pytest.raises(Unreadable, match="shape"):
        back(content, most=15000)


def test_objects_are_rejected():
    for value in (object(), np.array([None]), {1: {2}}):
        with pytest.raises(TypeError, match="is not sent"):
            written(value)
