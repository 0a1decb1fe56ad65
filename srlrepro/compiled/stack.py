"""Numbers on the stack: a tuple that a loop of compiled code reads and fills by index.

The type of a tuple says how many numbers it has. So a loop over them has a known end and unrolls, and the
numbers stay in registers. numba cannot write to a tuple, and its arrays are heap memory of unknown size.
"""

from typing import Any

import llvmlite.ir as ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, overload
from numpy.typing import NDArray

from srlrepro.compiled.jit import jit

MOST = 64  # numbers in a buffer: an 8×8 matrix
NUMBER = types.float64
BUFFER = types.CPointer(NUMBER)

Buffer = list[float]  # in compiled code a pointer


def _place(builder: Any, buffer: Any, index: int) -> Any:
    return builder.gep(buffer, [ir.Constant(ir.IntType(64), index)], inbounds=True)


@intrinsic
def _reserve(typing_context: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return cgutils.alloca_once(builder, ir.DoubleType(), size=MOST)

    return BUFFER(), generate


@intrinsic
def _unpack(typing_context: Any, values: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        buffer = cgutils.alloca_once(builder, ir.DoubleType(), size=MOST)
        for i in range(len(values)):
            builder.store(builder.extract_value(arguments[0], i), _place(builder, buffer, i))
        return buffer

    return BUFFER(values), generate


@intrinsic
def _pack(typing_context: Any, buffer: Any, like: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        values = cgutils.get_null_value(context.get_value_type(like))
        for i in range(len(like)):
            values = builder.insert_value(values, builder.load(_place(builder, arguments[0], i)), i)
        return values

    return like(buffer, like), generate


def _fits(values: Any) -> bool:
    """Whether a type is that of a tuple of float64 which a buffer holds."""
    return isinstance(values, types.UniTuple) and values.dtype == NUMBER and values.count <= MOST


def room() -> Buffer:
    """A buffer for `MOST` numbers; they are arbitrary at first. It lives until the function returns."""
    return [0.0] * MOST


@overload(room, inline="always")
def _compiled_room() -> Any:
    return lambda: _reserve()  # type: ignore[call-arg]


def unpacked(values: tuple[float, ...]) -> Buffer:
    """A buffer that begins with the numbers of a tuple."""
    return [*values, *[0.0] * (MOST - len(values))]


@overload(unpacked, inline="always", strict=False)
def _compiled_unpacked(values: Any) -> Any:
    return (lambda values: _unpack(values)) if _fits(values) else None  # type: ignore[call-arg]


def packed(buffer: Buffer, like: tuple[float, ...]) -> tuple[float, ...]:
    """The first numbers of a buffer as a tuple, as many as ``like`` has."""
    return tuple(buffer[: len(like)])


@overload(packed, inline="always", strict=False)
def _compiled_packed(buffer: Any, like: Any) -> Any:
    known = buffer == BUFFER and _fits(like)
    return (lambda buffer, like: _pack(buffer, like)) if known else None  # type: ignore[call-arg]


@jit
def read(array: NDArray[Any], like: tuple[float, ...]) -> tuple[float, ...]:
    """The first numbers of an array as a tuple, as many as ``like`` has."""
    values = room()
    for i in range(len(like)):
        values[i] = float(array[i])
    return packed(values, like)


@jit
def write(values: tuple[float, ...], out: NDArray[Any]) -> None:
    """Write a tuple into the first places of an array."""
    held = unpacked(values)
    for i in range(len(values)):
        out[i] = held[i]
