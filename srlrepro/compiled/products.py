"""Sums whose bits do not depend on the processor: matrix products, sums of rows and of squares.

A library splits the sum of an entry as the processor's vectors are wide. Here a vector runs along a row of
the result, and each of its numbers is one entry: C_ij = fma(A_ik, X_kj, C_ij) for k = 0, 1, … whatever the
width, with as many entries at a time as there are registers. It is as fast as the library.

The inner loops are written in the compiler's own language, because numba keeps no array in registers.
"""

from collections.abc import Callable
from typing import Any

import llvmlite.ir as ir
import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from srlrepro.compiled.jit import jit

Reals = NDArray[np.floating[Any]]
LINE = 64  # bytes of a vector: a cache line; one register, or two
TALL = 4  # rows of a tile: with eight, vectors of two registers do not fit into sixteen
WIDE = 4  # vectors of a tile of one row
SQUARE = 8  # rows and columns that are transposed at a time
WHOLE = ir.IntType(64)


class _Vectors:
    """Vectors of `LINE` bytes of one float type, for a builder of code.

    Args:
        left: if given, how many numbers of a vector there are in memory; the others are 0, and stay there.
    """

    def __init__(self, context: Any, builder: Any, dtype: Any, left: Any = None) -> None:
        self.builder, self.bytes = builder, dtype.bitwidth // 8
        self.kind, self.lanes = context.get_value_type(dtype), LINE // self.bytes
        self.type = ir.VectorType(self.kind, self.lanes)
        self.zero = ir.Constant(self.type, [0.0] * self.lanes)
        name = f"llvm.fma.v{self.lanes}f{dtype.bitwidth}"
        function = ir.FunctionType(self.type, [self.type] * 3)
        self._fma = cgutils.get_or_insert_function(builder.module, function, name)
        self._mask = None
        if left is not None:
            numbers = ir.Constant(ir.VectorType(WHOLE, self.lanes), list(range(self.lanes)))
            self._mask = builder.icmp_signed("<", numbers, self.spread(left))

    def fma(self, a: Any, b: Any, c: Any) -> Any:
        return self.builder.call(self._fma, (a, b, c))

    def _place(self, base: Any, number: int) -> Any:
        """The ``number``-th vector from an address on."""
        at = self.builder.gep(base, [ir.Constant(WHOLE, number * self.lanes)])
        return self.builder.bitcast(at, self.type.as_pointer())

    def _masked(self, name: str, result: Any, *arguments: Any) -> Any:
        """Call the masked load or store of the compiler."""
        kind = ir.FunctionType(result, [argument.type for argument in arguments])
        full = f"llvm.masked.{name}.v{self.lanes}f{self.bytes * 8}.p0"
        return self.builder.call(cgutils.get_or_insert_function(self.builder.module, kind, full), arguments)

    def load(self, base: Any, number: int = 0) -> Any:
        place = self._place(base, number)
        if self._mask is None:
            return self.builder.load(place, align=self.bytes)
        align = ir.Constant(ir.IntType(32), self.bytes)
        return self._masked("load", self.type, place, align, self._mask, self.zero)

    def store(self, value: Any, base: Any, number: int = 0) -> None:
        place = self._place(base, number)
        if self._mask is None:
            self.builder.store(value, place, align=self.bytes)
        else:
            align = ir.Constant(ir.IntType(32), self.bytes)
            self._masked("store", ir.VoidType(), value, place, align, self._mask)

    def spread(self, number: Any) -> Any:
        """A vector with the same number everywhere."""
        undefined = ir.Constant(ir.VectorType(number.type, self.lanes), ir.Undefined)
        first = self.builder.insert_element(undefined, number, ir.Constant(ir.IntType(32), 0))
        same = ir.Constant(ir.VectorType(ir.IntType(32), self.lanes), [0] * self.lanes)
        return self.builder.shuffle_vector(first, undefined, same)

    def loop(self, count: Any, starts: list[Any], step: Callable[[Any, list[Any]], list[Any]]) -> list[Any]:
        """Carry vectors through k = 0, …, count − 1, at least once: ``step(k, vectors)`` gives the next."""
        builder, before = self.builder, self.builder.block
        again, after = builder.append_basic_block("again"), builder.append_basic_block("after")
        builder.branch(again)
        builder.position_at_end(again)
        k, carried = builder.phi(WHOLE), [builder.phi(self.type) for _ in starts]
        results = step(k, carried)
        following = builder.add(k, ir.Constant(WHOLE, 1))
        k.add_incoming(ir.Constant(WHOLE, 0), before)
        k.add_incoming(following, again)
        for phi, start, result in zip(carried, starts, results, strict=True):
            phi.add_incoming(start, before)
            phi.add_incoming(result, again)
        builder.cbranch(builder.icmp_signed("<", following, count), again, after)
        builder.position_at_end(after)
        return results


def _tile(rows: int, vectors: int, whole: bool = True) -> Any:
    """C[i + r, j + …] for r < rows and so many vectors; A_ik lies at a[i outer + k inner].

    ``whole``: False: the row of C ends within the vector.
    """

    @intrinsic
    def tile(typing: Any, a: Any, outer: Any, inner: Any, x: Any, c: Any, i: Any, j: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> None:
            a, outer, inner, x, c, i, j = arguments
            kinds = signature.args
            left, right, out = (
                context.make_array(kinds[n])(context, builder, value) for n, value in ((0, a), (3, x), (4, c))
            )
            count, across = cgutils.unpack_tuple(builder, right.shape)
            _, stride = cgutils.unpack_tuple(builder, out.shape)
            v = _Vectors(context, builder, kinds[0].dtype, None if whole else builder.sub(stride, j))
            lines = [builder.add(i, ir.Constant(WHOLE, r)) for r in range(rows)]
            starts = [builder.gep(left.data, [builder.mul(line, outer)]) for line in lines]

            def step(k: Any, sums: list[Any]) -> list[Any]:
                row = builder.gep(right.data, [builder.add(builder.mul(k, across), j)])
                xs = [v.load(row, n) for n in range(vectors)]
                along = [builder.mul(k, inner)]
                factors = [v.spread(builder.load(builder.gep(start, along))) for start in starts]
                pairs = [(factor, x) for factor in factors for x in xs]
                return [v.fma(*pair, old) for pair, old in zip(pairs, sums, strict=True)]

            sums = v.loop(count, [v.zero] * (rows * vectors), step)
            for r, line in enumerate(lines):
                place = builder.gep(out.data, [builder.add(builder.mul(line, stride), j)])
                for n in range(vectors):
                    v.store(sums[r * vectors + n], place, n)

        return types.void(a, outer, inner, x, c, i, j), generate

    return tile


_tall, _three, _flat, _one = _tile(TALL, 1), _tile(3, 1), _tile(1, WIDE), _tile(1, 1)
_tall_end, _one_end = _tile(TALL, 1, whole=False), _tile(1, 1, whole=False)


@jit
def _product(a: Reals, outer: int, inner: int, x: Reals, out: Reals) -> None:
    lanes = LINE // out.itemsize
    rows, columns = out.shape
    tall, end = rows // TALL * TALL, columns // lanes * lanes
    for j in range(0, end, lanes):
        for i in range(0, tall, TALL):
            _tall(a, outer, inner, x, out, i, j)
    left = rows - tall
    if left == 3:
        for j in range(0, end, lanes):
            _three(a, outer, inner, x, out, tall, j)
    else:
        flat = columns // (WIDE * lanes) * (WIDE * lanes)
        for i in range(tall, rows):
            for j in range(0, flat, WIDE * lanes):
                _flat(a, outer, inner, x, out, i, j)
            for j in range(flat, end, lanes):
                _one(a, outer, inner, x, out, i, j)
    if end < columns:
        for i in range(0, tall, TALL):
            _tall_end(a, outer, inner, x, out, i, end)
        for i in range(tall, rows):
            _one_end(a, outer, inner, x, out, i, end)


@jit
def product(a: Reals, x: Reals, out: Reals) -> None:
    """Write A X to out [M, N] of A [M, K] and X [K, N], K > 0; contiguous arrays of one float type."""
    _product(a, a.shape[1], 1, x, out)


@jit
def product_transposed(a: Reals, x: Reals, out: Reals) -> None:
    """Write Aᵀ X to out [M, N] of A [K, M] and X [K, N], K > 0; contiguous arrays of one float type."""
    _product(a, 1, a.shape[1], x, out)


@intrinsic
def _turn(typing: Any, a: Any, out: Any, i: Any, j: Any) -> Any:
    """out[j + c, i + r] = a[i + r, j + c] for r, c < SQUARE: blocks beside the diagonal change places."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> None:
        a, out, i, j = arguments
        read, written = (
            context.make_array(signature.args[n])(context, builder, v) for n, v in ((0, a), (1, out))
        )
        kind = ir.VectorType(context.get_value_type(signature.args[0].dtype), SQUARE)
        align = signature.args[0].dtype.bitwidth // 8

        def place(array: Any, row: Any, n: int, column: Any) -> Any:
            _, stride = cgutils.unpack_tuple(builder, array.shape)
            line = builder.mul(builder.add(row, ir.Constant(WHOLE, n)), stride)
            return builder.bitcast(builder.gep(array.data, [builder.add(line, column)]), kind.as_pointer())

        rows = [builder.load(place(read, i, n, j), align=align) for n in range(SQUARE)]
        for width in (1, 2, 4):
            lanes = range(SQUARE)
            low = [n if not n & width else SQUARE + n - width for n in lanes]
            high = [n + width if not n & width else SQUARE + n for n in lanes]
            first, second = (ir.Constant(ir.VectorType(ir.IntType(32), SQUARE), c) for c in (low, high))
            for n in (n for n in lanes if not n & width):
                pair = rows[n], rows[n + width]
                rows[n] = builder.shuffle_vector(*pair, first)
                rows[n + width] = builder.shuffle_vector(*pair, second)
        for n, row in enumerate(rows):
            builder.store(row, place(written, j, n, i), align=align)

    return types.void(a, out, i, j), generate


@jit
def transpose(a: Reals, out: Reals) -> None:
    """Write aᵀ to out [N, M] of a [M, N]; contiguous arrays of one float type."""
    rows, columns = a.shape[0] // SQUARE * SQUARE, a.shape[1] // SQUARE * SQUARE
    for i in range(0, rows, SQUARE):
        for j in range(0, columns, SQUARE):
            _turn(a, out, i, j)  # type: ignore[call-arg]
    for i in range(a.shape[0]):
        for j in range(columns if i < rows else 0, a.shape[1]):
            out[j, i] = a[i, j]


@intrinsic
def _squares(typing: Any, x: Any, count: Any, sums: Any) -> Any:
    """Write the sums of x[l + W k]² over k < count to the W = WIDE lanes of sums."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> None:
        x, count, sums = arguments
        numbers, out = (
            context.make_array(signature.args[n])(context, builder, value) for n, value in ((0, x), (2, sums))
        )
        v = _Vectors(context, builder, signature.args[0].dtype)

        def step(k: Any, carried: list[Any]) -> list[Any]:
            start = builder.gep(numbers.data, [builder.mul(k, ir.Constant(WHOLE, WIDE * v.lanes))])
            xs = [v.load(start, n) for n in range(WIDE)]
            return [v.fma(x, x, old) for x, old in zip(xs, carried, strict=True)]

        for n, value in enumerate(v.loop(count, [v.zero] * WIDE, step)):
            v.store(value, out.data, n)

    return types.void(x, count, sums), generate


@jit
def square_sum(x: Reals) -> float:
    """Σ x² of a contiguous x [N]: WIDE vectors of running sums, then added up in double precision."""
    width = WIDE * (LINE // x.itemsize)
    sums, count = np.zeros(width, x.dtype), x.size // width
    if count > 0:
        _squares(x, count, sums)  # type: ignore[call-arg]
    total = 0.0
    for value in sums:
        total += float(value)
    for i in range(count * width, x.size):
        total += np.float64(x[i]) * np.float64(x[i])
    return total
