"""Numbers, texts, arrays and dataclasses as bytes, safe to read from an untrusted process: nothing is executed."""

import json
import sys
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from typing import IO, Any

import numpy as np

_KINDS = "biufcSU"  # of arrays: no objects
_COMPRESSED = ("csr", "csc")


class Unreadable(Exception):
    """The bytes are none that :func:`write` makes, or need more memory than they may."""


def write(file: IO[bytes], value: Any) -> None:
    """Write a value: a line with the sizes, its structure as JSON, then the numbers of its arrays.  Local.

    Values are None, bool, int, float, str, arrays and scalars of NumPy, sparse matrices of SciPy, dataclasses, and lists,
    tuples and mappings of values.

    Raises
    ------
    TypeError : it holds something else
    """
    arrays: list[np.ndarray] = []
    tree = _encode(value, arrays)
    text = json.dumps([tree, [[array.dtype.str, array.shape] for array in arrays]]).encode("ascii")
    file.write(b"%d\n" % len(text) + text)
    for array in arrays:
        file.write(array.data if array.flags.c_contiguous and array.size else array.tobytes())
    file.flush()


def read(file: IO[bytes], types: Iterable[type] = (), most: float = float("inf")) -> Any:
    """Return a value as it was written, its dataclasses of the ``types``, its arrays of ``most`` bytes together.  Local.

    Raises
    ------
    Unreadable : other contents
    """
    try:
        n_bytes = int(file.readline(32))
        if not 0 < n_bytes <= most:
            raise Unreadable(f"{n_bytes} bytes of structure")
        tree, headers = json.loads(_bytes(file, n_bytes))
        arrays = []
        for kind, shape in headers:
            arrays.append(_array(file, np.dtype(kind), tuple(shape), most))
            most -= arrays[-1].nbytes
        return _decode(tree, arrays, {kind.__name__: kind for kind in types})
    except (ValueError, TypeError, KeyError, IndexError, RecursionError, OverflowError) as problem:
        raise Unreadable(f"{type(problem).__name__}: {problem}") from None


def _encode(value: Any, arrays: list[np.ndarray]) -> Any:
    """Return a value as JSON has it: itself, or a list of its kind and parts; arrays go into the list of them."""
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, (np.ndarray, np.generic, complex)):
        array = np.asarray(value)
        if array.dtype.kind not in _KINDS:
            raise TypeError(f"an array of the type {array.dtype} is not sent")
        arrays.append(np.ascontiguousarray(array).reshape(array.shape))
        return ["array" if isinstance(value, np.ndarray) else "scalar", len(arrays) - 1]
    if isinstance(value, (list, tuple)):
        return ["list" if isinstance(value, list) else "tuple", [_encode(each, arrays) for each in value]]
    if isinstance(value, Mapping):
        return ["dict", [[_encode(key, arrays), _encode(each, arrays)] for key, each in value.items()]]
    if is_dataclass(value) and not isinstance(value, type):
        parts = {each.name: _encode(getattr(value, each.name), arrays) for each in fields(value)}
        return ["object", type(value).__name__, parts]
    if "scipy.sparse" in sys.modules and sys.modules["scipy.sparse"].issparse(value):
        matrix = value if value.format in _COMPRESSED else value.tocsr()
        return [matrix.format, _encode([*matrix.shape, matrix.data, matrix.indices, matrix.indptr], arrays)]
    raise TypeError(f"a value of the type {type(value).__name__} is not sent")


def _decode(tree: Any, arrays: list[np.ndarray], types: Mapping[str, type]) -> Any:
    """Return the value of a structure."""
    if not isinstance(tree, list):
        if isinstance(tree, dict):
            raise Unreadable("a mapping where a value is expected")
        return tree
    kind, *parts = tree
    if kind in ("array", "scalar"):
        return arrays[parts[0]] if kind == "array" else arrays[parts[0]][()]
    if kind in ("list", "tuple"):
        values = [_decode(each, arrays, types) for each in parts[0]]
        return values if kind == "list" else tuple(values)
    if kind == "dict":
        return {_decode(key, arrays, types): _decode(each, arrays, types) for key, each in parts[0]}
    if kind == "object":
        name, values = parts
        return types[name](**{key: _decode(each, arrays, types) for key, each in values.items()})
    if kind in _COMPRESSED:
        return _matrix(kind, *_decode(parts[0], arrays, types))
    raise Unreadable(f"a value of the kind {str(kind)[:40]!r}")


def _matrix(kind: str, n_rows: int, n_columns: int, *arrays: np.ndarray) -> Any:
    """Return a sparse matrix whose indices lie within it."""
    import scipy.sparse as sp

    matrix = (sp.csr_matrix if kind == "csr" else sp.csc_matrix)(arrays, (n_rows, n_columns))
    matrix.check_format(full_check=True)
    return matrix


def _array(file: IO[bytes], dtype: np.dtype, shape: tuple[int, ...], most: float) -> np.ndarray:
    n = 1
    for length in shape:
        n *= length
    if dtype.kind not in _KINDS or dtype.fields or not 0 <= n * dtype.itemsize <= most or min(shape, default=0) < 0:
        raise Unreadable(f"an array of the type {dtype} and the shape {shape}")
    array = np.empty(shape, dtype)
    if array.nbytes:
        array.reshape(-1).view(np.uint8)[:] = np.frombuffer(_bytes(file, array.nbytes), dtype=np.uint8)
    return array


def _bytes(file: IO[bytes], n: int) -> bytes:
    data = file.read(n)
    if len(data) < n:
        raise Unreadable(f"it ends after {len(data)} of {n} bytes")
    return data
