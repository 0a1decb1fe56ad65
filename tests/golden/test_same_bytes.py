"""A small grid has the bytes of the kept digests on this processor, and on emulated ones."""

import pytest

from benchmarks import same_bytes
from benchmarks.same_bytes import DELTA, FAMILIES, ROOT, SEED, differing, digest, emulated, grid, kept
from srlrepro import pins
from srlrepro.learner.policy import load_policy

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not pins.is_covered(), reason="not an x86-64 processor with AVX2 and FMA"),
]


@pytest.fixture(scope="module")
def here() -> dict[str, str]:
    """The digests of the small grid, made by this processor."""
    return grid()


def test_the_small_grid_has_the_golden_digests(here: dict[str, str]) -> None:
    wanted = kept()
    assert wanted is not None, "python -m benchmarks.same_bytes --write makes them"
    assert differing(here, wanted) == []


def test_a_run_of_full_length_has_the_golden_digests() -> None:
    """And so has the committed policy of this run."""
    wanted = kept(long=True)
    assert wanted is not None, "python -m benchmarks.same_bytes --long --write makes them"
    assert differing(grid(long=True), wanted) == []
    policy = load_policy(ROOT / "policies" / f"alpha_0.5__delta_{DELTA}__seed_{SEED}.npz")
    assert digest(*policy.weights, *policy.biases, policy.log_std) == wanted["policy 0.5"]


def test_folder_home_zone_locale_and_hashes_of_python_do_not_matter(here: dict[str, str]) -> None:
    others = {"HOME": "/nowhere", "TZ": "Asia/Tokyo", "LC_ALL": "C", "PYTHONHASHSEED": "7", "COLUMNS": "40"}
    assert differing(grid(**others), here) == []


@pytest.mark.parametrize("family", [name for name in emulated() if name != "host"])
def test_another_family_makes_the_same_bytes(family: str, here: dict[str, str]) -> None:
    """numba compiles for it, which takes a minute, and OpenBLAS takes its kernels."""
    assert differing(grid(family), here) == []


def test_a_family_names_its_instructions_beside_its_processor() -> None:
    """Else numba would keep the vector width of this processor, and nothing would be emulated."""
    for name, values in FAMILIES.items():
        assert name == "host" or {"NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"} <= values.keys()
    assert same_bytes.AVX512 not in FAMILIES["haswell"]["NUMBA_CPU_FEATURES"]


def test_a_difference_is_named() -> None:
    assert differing({"a": "1", "b": "2"}, {"a": "1", "b": "3"}) == ["b"]
    assert differing({"a": "1"}, {"a": "1", "c": "3"}) == ["c"]
