"""A condition and its name say the same."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srlrepro.settings.condition import MOST_SEED, Condition, alpha_text, parse_alpha
from srlrepro.settings.fields import ParameterError

ALPHAS = st.none() | st.integers(0, 1000).map(lambda n: n / 1000)
CONDITIONS = st.builds(Condition, ALPHAS, st.integers(1, 9999).map(lambda n: n / 100), st.integers(0, 10_000))


@settings(deadline=None)
@given(CONDITIONS)
def test_a_condition_is_read_back_from_its_name(condition: Condition) -> None:
    assert Condition.parse(condition.name) == condition
    assert parse_alpha(condition.alpha_text) == condition.alpha == parse_alpha(alpha_text(condition.alpha))


NO_NAMES = (
    "",
    "alpha_0",
    "alpha_2__delta_1__seed_0",
    "alpha_0__delta_0__seed_0",
    "alpha_0__delta_1.10__seed_0",
    "alpha_none__delta_1__seed_-1",
    "alpha_x__delta_1__seed_0",
    "delta_1__alpha_0__seed_0",
)


@pytest.mark.parametrize("name", NO_NAMES)
def test_another_name_is_refused_in_one_line(name: str) -> None:
    with pytest.raises(ParameterError) as refusal:
        Condition.parse(name)
    assert "\n" not in str(refusal.value)


def test_seeds_are_those_that_numpys_older_generator_takes() -> None:
    assert Condition(0.5, 1.1, MOST_SEED).seed == MOST_SEED
    np.random.RandomState(MOST_SEED)
    with pytest.raises(ValueError, match="Seed must be between"):
        np.random.RandomState(MOST_SEED + 1)
    for seed in (-1, MOST_SEED + 1, 0.0, True):
        with pytest.raises(ParameterError, match=f"seed = {seed}: must be a whole number"):
            Condition(0.5, 1.1, seed)  # type: ignore[arg-type]
