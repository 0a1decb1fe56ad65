"""The compiler: a kernel that only compiled code calls does not crash Python that calls it."""

from typing import Any

import numpy as np

from srlrepro.compiled.jit import inner, jit


@inner
def doubled(x: float) -> float:
    return 2 * x


@jit
def fourfold(x: float) -> float:
    return doubled(doubled(x))


def test_an_inner_kernel_runs_uncompiled_in_python_before_and_after_it_is_compiled() -> None:
    for _ in range(2):
        assert doubled(1.5) == 3.0 and doubled(np.float64(1.5)) == 3.0
        text: Any = doubled("ab")  # type: ignore[arg-type]  # which no compiled code does
        assert text == "abab"
        assert fourfold(1.5) == 6.0
