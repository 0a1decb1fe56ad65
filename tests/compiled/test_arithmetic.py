"""Fused multiply-add against exact arithmetic, and sine and cosine against many digits."""

import math
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from numba import njit

from srlrepro.compiled.arithmetic import LARGEST, fma, sin_cos

UNITS = 2  # of rounding


@njit
def compiled_fma(a, b, c):  # type: ignore[no-untyped-def]
    return fma(a, b, c)


def test_a_product_is_not_rounded_before_the_sum(rng: np.random.Generator) -> None:
    a, b = rng.standard_normal((2, 200))
    for x, y in zip(a.tolist(), b.tolist(), strict=True):
        error = Fraction(x) * Fraction(y) - Fraction(x * y)  # what rounding the product loses
        assert compiled_fma(x, y, -x * y) == fma(x, y, -x * y) == float(error)
    assert any(x * y - x * y != fma(x, y, -x * y) for x, y in zip(a.tolist(), b.tolist(), strict=True))
    one, small = np.float32(1), np.float32(2.0**-12)
    assert compiled_fma(one + small, one + small, -one) == np.float32(2.0**-11 + 2.0**-24)
    assert math.isnan(fma(math.inf, 0.0, 1.0)) and fma(math.inf, 1.0, 1.0) == math.inf


def test_types_are_not_mixed() -> None:
    with pytest.raises(Exception, match="No implementation"):
        compiled_fma(np.float32(1), 1.0, 1.0)


def test_sine_and_cosine_to_two_units_of_rounding(rng: np.random.Generator) -> None:
    turns = (np.arange(-400, 400) * math.pi / 4).tolist()
    drawn = [*rng.uniform(-4, 4, 1000), *rng.uniform(-3000, 3000, 1000), *rng.uniform(-LARGEST, LARGEST, 500)]
    with mpmath.workprec(200):
        for x in [*turns, *map(float, drawn), 0.0, 1e-300, -1e-9]:
            exact = mpmath.sin(mpmath.mpf(x)), mpmath.cos(mpmath.mpf(x))
            for found, value in zip(sin_cos(x), exact, strict=True):
                assert abs(mpmath.mpf(found) - value) <= UNITS * math.ulp(float(value)), x


def test_uncompiled_it_has_the_same_bits(rng: np.random.Generator) -> None:
    for x in map(float, rng.uniform(-50, 50, 200)):
        assert sin_cos.py_func(x) == sin_cos(x)


def test_what_is_no_angle_is_the_librarys() -> None:
    assert sin_cos(2 * LARGEST) == (math.sin(2 * LARGEST), math.cos(2 * LARGEST))
    assert all(map(math.isnan, sin_cos(math.nan))) and all(map(math.isnan, sin_cos(math.inf)))
