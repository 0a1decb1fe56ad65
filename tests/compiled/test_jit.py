"""The compiler: what only compiled code calls is refused in Python, and does not crash it."""

import numpy as np
import pytest

from srlrepro.compiled.jit import inner, jit


@inner
def doubled(x: float) -> float:
    return 2 * x


@jit
def fourfold(x: float) -> float:
    return doubled(doubled(x))


def test_an_inner_kernel_is_refused_in_python_before_and_after_it_is_compiled() -> None:
    for _ in range(2):
        for argument in (1.5, np.float64(1.5)):
            with pytest.raises(TypeError, match="doubled is for compiled code"):
                doubled(argument)
        assert fourfold(1.5) == 6.0
    assert doubled.py_func(1.5) == 3.0  # type: ignore[attr-defined]
