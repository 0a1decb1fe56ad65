"""Products and sums against the library's, in the written order, and compiled for other processors."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from srlrepro.compiled.arithmetic import fma
from srlrepro.compiled.products import WIDE, product, product_transposed, square_sum, transpose

ROOT = Path(__file__).parents[2]
PRECISIONS = pytest.mark.parametrize("kind", [np.float32, np.float64])
SHAPES = [
    (128, 8, 16),
    (128, 128, 16),
    (3, 128, 16),
    (1, 128, 128),
    (5, 7, 21),
    (6, 3, 5),
    (2, 4, 70),
    (4, 1, 1),
]
WITHOUT_512 = "-avx512f,-avx512vl,-avx512bw,-avx512dq,-avx512cd"
FAMILIES = {"haswell": "+avx2,+fma,", "znver2": "+avx2,+fma,", "skylake-avx512": ""}


def draw(kind: Any, shape: tuple[int, int, int]) -> tuple[Any, Any, Any]:
    """A [M, K], X [K, N] and room for the result."""
    rng, (rows, inner, columns) = np.random.default_rng(2), shape
    a, x = (rng.standard_normal(size).astype(kind) for size in ((rows, inner), (inner, columns)))
    return a, x, np.full((rows, columns), np.nan, kind)


@PRECISIONS
@pytest.mark.parametrize("shape", SHAPES)
def test_a_product_is_the_librarys(kind: Any, shape: tuple[int, int, int]) -> None:
    a, x, out = draw(kind, shape)
    product(a, x, out)
    exact = a.astype(np.longdouble) @ x.astype(np.longdouble)
    np.testing.assert_allclose(out, exact.astype(kind), rtol=0, atol=shape[1] * 4 * np.finfo(kind).eps)
    turned = np.full_like(out, np.nan)
    product_transposed(np.ascontiguousarray(a.T), x, turned)
    assert turned.tobytes() == out.tobytes()


@PRECISIONS
def test_every_entry_is_summed_in_its_order(kind: Any) -> None:
    a, x, out = draw(kind, (5, 7, 21))
    product(a, x, out)
    if kind is np.float64:  # where `fma` is exact outside compiled code
        for i, j in ((0, 0), (3, 15), (4, 20)):
            total = 0.0
            for k in range(7):
                total = fma(float(a[i, k]), float(x[k, j]), total)
            assert out[i, j] == total
    alone = np.empty((5, 1), kind)
    product(a, np.ascontiguousarray(x[:, 20:]), alone)
    assert (alone[:, 0] == out[:, 20]).all()


@PRECISIONS
def test_nothing_is_written_beside_the_result(kind: Any) -> None:
    a, x, _ = draw(kind, (6, 3, 21))
    room = np.full((8, 21), np.nan, kind)
    product(a, x, room[1:7])
    assert np.isnan(room[[0, 7]]).all() and not np.isnan(room[1:7]).any()


@PRECISIONS
@pytest.mark.parametrize("shape", [(128, 16), (8, 16), (3, 16), (5, 21), (24, 9), (1, 1)])
def test_a_transposed_matrix(kind: Any, shape: tuple[int, int], rng: np.random.Generator) -> None:
    a = rng.standard_normal(shape).astype(kind)
    out = np.full(shape[::-1], np.nan, kind)
    transpose(a, out)
    assert (out == a.T).all()


@PRECISIONS
@pytest.mark.parametrize("size", [0, 3, 64, 1000, 37_123])
def test_the_sum_of_squares(kind: Any, size: int, rng: np.random.Generator) -> None:
    x = rng.standard_normal(size).astype(kind)
    width = WIDE * 64 // x.itemsize
    expected = (x.astype(np.float64) ** 2).sum()
    assert square_sum(x) == pytest.approx(expected, rel=1e-5 if kind is np.float32 else 1e-13)
    if size < width:
        assert square_sum(x) == sum(float(v) ** 2 for v in x)


def digest() -> str:
    """SHA-256 of products and sums of all shapes."""
    found = hashlib.sha256()
    for kind in (np.float32, np.float64):
        for shape in SHAPES:
            a, x, out = draw(kind, shape)
            product(a, x, out)
            found.update(out.tobytes() + np.float64(square_sum(a.ravel())).tobytes())
    return found.hexdigest()


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_another_family_has_the_same_bits(family: str, tmp_path: Path) -> None:
    """Compiled for another processor: other instructions, and vectors of another width."""
    features = FAMILIES[family] + (WITHOUT_512 if FAMILIES[family] else "")
    environment = os.environ | {"NUMBA_CPU_NAME": family, "NUMBA_CACHE_DIR": str(tmp_path)}
    if features:
        environment["NUMBA_CPU_FEATURES"] = features
    code = "from test_products import digest; print(digest())"
    paths = os.pathsep.join([str(ROOT), str(Path(__file__).parent)])
    command = [sys.executable, "-c", code]
    done = subprocess.run(
        command, env=environment | {"PYTHONPATH": paths}, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == digest()
