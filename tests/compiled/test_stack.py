"""Buffers on the stack: what is put in comes out, in nested calls and loops too."""

import numpy as np
import pytest
from numba import njit

from srlrepro.compiled.stack import packed, read, room, unpacked, write


@njit
def turned(values):  # type: ignore[no-untyped-def]
    """The values in their reverse order; a callee has buffers of its own."""
    held, out, n = unpacked(values), room(), len(values)
    for i in range(n):
        out[i] = held[n - 1 - i]
    return packed(out, values)


@njit
def twice_and_sum(values):  # type: ignore[no-untyped-def]
    held, total = unpacked(values), 0.0
    for _ in range(1000):  # buffers that a loop reserves do not pile up
        again = unpacked(turned(turned(values)))
        for i in range(len(values)):
            total += again[i] - held[i]
    return packed(held, values), total


@pytest.mark.parametrize("count", [1, 3, 16, 64])
def test_what_is_put_in_comes_out(count: int, rng: np.random.Generator) -> None:
    values = tuple(rng.standard_normal(count).tolist())
    assert turned(values) == turned.py_func(values) == values[::-1]
    assert twice_and_sum(values) == twice_and_sum.py_func(values) == (values, 0.0)


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.int64])
def test_arrays_are_read_and_written(kind: type) -> None:
    array, like = np.arange(5).astype(kind), (0.0,) * 3
    assert read(array, like) == read.py_func(array, like) == (0.0, 1.0, 2.0)
    for copy in (write, write.py_func):
        out = np.full(5, 9, kind)
        copy((1.0, 2.0, 3.0), out)
        assert out.tolist() == [1, 2, 3, 9, 9]


@pytest.mark.parametrize("values", [(0.0,) * 65, (1, 2), (1.0, 2)])
def test_other_tuples_are_refused(values: tuple[float, ...]) -> None:
    with pytest.raises(Exception, match="No implementation"):
        turned(values)
