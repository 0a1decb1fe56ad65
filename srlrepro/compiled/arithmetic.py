"""Fused multiply-add, sine and cosine for compiled code: the same bits on every processor.

The C library has several sines, of which it takes one by the processor that it meets, and its versions
differ. The pair here is a Taylor polynomial after a reduction of the argument, with the order of every
operation written down. It costs less than one call of the library.
"""

import math
from fractions import Fraction
from typing import Any

import llvmlite.ir as ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, overload

from srlrepro.compiled.jit import jit

TERMS = 8  # of each polynomial: what it leaves out on [-π/4, π/4] lies below half a unit of rounding
SINE = tuple((-1.0) ** n / math.factorial(2 * n + 1) for n in range(TERMS, 0, -1))  # of r², r³ left out
COSINE = tuple((-1.0) ** n / math.factorial(2 * n) for n in range(TERMS, 1, -1))  # of r², r⁴ left out
# π/2 as a sum of three doubles, so that n π/2 can be taken from x with little error.
HALF_PI = (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591698e-33)
LARGEST = 1e5  # rad: up to here the reduction is good; an angle of the pendulum stays far below
ROUND = 1.5 * 2.0**52  # to add it and take it away rounds to a whole number


@intrinsic
def _fused(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    """a b + c of three numbers of one float type, by the processor's instruction."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = context.get_value_type(signature.return_type)
        name = "llvm.fma.f32" if signature.return_type is types.float32 else "llvm.fma.f64"
        function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(kind, [kind] * 3), name)
        return builder.call(function, arguments)

    return a(a, a, a), generate


def fma(a: Any, b: Any, c: Any) -> Any:
    """a b + c, rounded once; in compiled code all three float64 or all three float32."""
    if not all(map(math.isfinite, (a, b, c))):
        return a * b + c
    return float(Fraction(float(a)) * Fraction(float(b)) + Fraction(float(c)))


@overload(fma)
def _compiled_fma(a: Any, b: Any, c: Any) -> Any:
    def compiled(a: Any, b: Any, c: Any) -> Any:
        return _fused(a, b, c)  # type: ignore[call-arg]

    known = a == b == c and a in (types.float32, types.float64)
    return compiled if known else None


@jit
def sin_cos(x: float) -> tuple[float, float]:
    """(sin x, cos x) of an angle in rad, to within two units of rounding."""
    if not abs(x) < LARGEST:  # infinity and NaN too
        return math.sin(x), math.cos(x)
    n = fma(x, 2.0 / math.pi, ROUND) - ROUND  # quarter turns
    r = fma(-n, HALF_PI[2], fma(-n, HALF_PI[1], fma(-n, HALF_PI[0], x)))
    z = r * r
    p, q = SINE[0], COSINE[0]
    for i in range(1, TERMS):
        p = fma(p, z, SINE[i])
    for i in range(1, TERMS - 1):
        q = fma(q, z, COSINE[i])
    sine, cosine = fma(r * z, p, r), fma(z * z, q, fma(-0.5, z, 1.0))
    turns = int(n) & 3
    if turns & 1:
        sine, cosine = cosine, -sine
    if turns & 2:
        sine, cosine = -sine, -cosine
    return sine, cosine
