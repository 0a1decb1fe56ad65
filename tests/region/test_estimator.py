"""The safe region of any system as an estimator of scikit-learn: its own checks, pipelines, any dimension."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy.sparse import csr_array
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.utils.estimator_checks import check_estimator

from srlrepro.region.safe_region import SafeRegion
from srlrepro.settings.fields import ParameterError

Arrays = NDArray[Any]

# What scikit-learn's checks expect and a safe region is not, in this one place.
WORDS = "the message says the same in this package's words: the parameter, its value, what is allowed"
LABELS = "labels are 0 (unsafe) and 1 (safe); others have no meaning"
SINGLE = "a state alone [d] is a batch of one"
NAMES = "the arguments of fit are named x and z, as in the paper"
EXCEPTIONS = {
    "check_fit_score_takes_y": NAMES,
    "check_sample_weight_equivalence_on_dense_data": f"{NAMES}; and Ω and t-SNE take states of any weight",
    "check_estimators_dtypes": LABELS,
    "check_sample_weights_pandas_series": LABELS,
    "check_sample_weights_not_an_array": LABELS,
    "check_sample_weights_shape": LABELS,
    "check_sample_weights_not_overwritten": LABELS,
    "check_classifier_data_not_an_array": LABELS,
    "check_classifiers_classes": LABELS,
    "check_fit2d_1feature": LABELS,
    "check_n_features_in_after_fitting": WORDS,
    "check_complex_data": WORDS,
    "check_estimators_empty_data_messages": WORDS,
    "check_classifiers_regression_target": WORDS,
    "check_classifier_not_supporting_multiclass": WORDS,
    "check_fit2d_1sample": WORDS,
    "check_requires_y_none": WORDS,
    "check_supervised_y_2d": "labels have the shape [k]; others are refused, where a warning is expected",
    "check_fit2d_predict1d": SINGLE,
}


@pytest.mark.slow
def test_scikit_learns_checks_hold_but_for_the_exceptions() -> None:
    region = SafeRegion(state_max=None, psi="neighbours")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = check_estimator(region, expected_failed_checks=EXCEPTIONS, on_fail=None)
    failed = {check["check_name"]: str(check["exception"]) for check in found if check["status"] == "failed"}
    assert failed == {}
    assert {check["check_name"] for check in found if check["status"] == "xfail"} == set(EXCEPTIONS)
    assert sum(check["status"] == "passed" for check in found) > 40


@pytest.fixture
def rings() -> tuple[Arrays, Arrays, Arrays]:
    """States [90, 4] of another system in other units, safe near the origin, and trajectories [90, 5, 4]."""
    x = np.random.default_rng(3).uniform(-1, 1, (90, 4)) * [100.0, 1.0, 0.01, 5.0]
    z = (np.abs(x[:, 0]) < 50).astype(int)
    towards = np.where(z[:, None] == 1, 0.5, 1.5)
    return x, z, np.stack([x * towards**t for t in range(5)], axis=1)


@pytest.mark.parametrize("psi", ["neighbours", "network"])
def test_states_of_any_dimension_and_unit_are_learned(
    rings: tuple[Arrays, ...], tmp_path: Path, psi: str
) -> None:
    """Ranges that are given, or the largest |x|: in other units, the same region."""
    x, z, paths = rings
    given = SafeRegion(state_max=tuple(np.abs(x).max(axis=0).tolist()), psi=psi).fit(x, z, paths)
    found = SafeRegion(state_max=None, psi=psi).fit(x, z, paths)
    np.testing.assert_array_equal(found.safety(x), given.safety(x))
    assert found.state_max is None and found.n_features_in_ == 4
    assert (found.safety(x) > 0.5).astype(int).tolist() == z.tolist()
    unit = np.array([0.5, 4.0, 1024.0, 2.0])  # powers of two: no rounding
    other = SafeRegion(state_max=None, psi=psi).fit(unit * x, z, unit * paths)
    np.testing.assert_array_equal(other.safety(unit * x), found.safety(x))
    found.save(tmp_path / "region.npz")
    back = SafeRegion.load(tmp_path / "region.npz")
    assert back.get_params() == found.get_params() and back.n_features_in_ == 4
    np.testing.assert_array_equal(back.safety(x), found.safety(x))
    with pytest.raises(ParameterError, match=r"^x = shape \(90, 3\): must be states of shape \[B, 4\]"):
        back.predict(x[:, :3])


def test_a_coordinate_that_is_always_zero_tells_nothing(rings: tuple[Arrays, ...]) -> None:
    x, z, paths = rings
    flat = SafeRegion(state_max=None).fit(x * [1, 0, 1, 1], z, paths * [1, 0, 1, 1])
    without = SafeRegion(state_max=None).fit(x[:, [0, 2, 3]], z, paths[:, :, [0, 2, 3]])
    assert flat.arrays_.scale[1] == 1.0
    np.testing.assert_array_equal(flat.arrays_.scale[[0, 2, 3]], without.arrays_.scale)


def test_without_trajectories_the_states_alone_are_compared(rings: tuple[Arrays, ...]) -> None:
    x, z, paths = rings
    alone = SafeRegion(state_max=None).fit(x, z)
    still, moving = (SafeRegion(state_max=None).fit(x, z, of) for of in (x[:, None], paths))
    np.testing.assert_array_equal(alone.embedding_, still.embedding_)
    assert (alone.embedding_ != moving.embedding_).any()


def test_a_pipeline_and_a_search_pass_the_trajectories_on(rings: tuple[Arrays, ...]) -> None:
    x, z, paths = rings
    region = SafeRegion(state_max=None, psi="neighbours")
    line = make_pipeline(region, LogisticRegression()).fit(x, z, saferegion__trajectories=paths)
    np.testing.assert_array_equal(line[0].transform(x), region.fit(x, z, paths).transform(x))
    assert line.score(x, z) > 0.9
    search = GridSearchCV(region, {"p_t": [0.5, 0.999]}, cv=2).fit(x, z, trajectories=paths)
    assert search.best_params_ == {"p_t": 0.5}


def test_names_of_columns_are_kept_and_compared(rings: tuple[Arrays, ...]) -> None:
    x, z, paths = rings
    frame = pd.DataFrame(x, columns=list("abcd"))
    region = SafeRegion(state_max=None, psi="neighbours").fit(frame, z, paths)
    assert region.feature_names_in_.tolist() == list("abcd")
    np.testing.assert_array_equal(region.safety(frame), region.safety(x))
    with pytest.raises(ValueError, match="feature names"):
        region.predict(frame[list("dcba")])


@pytest.mark.parametrize(
    ("spoilt", "message"),
    [
        (lambda x: x + 1j, "x = complex numbers: must be real ones"),
        (csr_array, "x = a sparse array: must be a dense one"),
        (lambda x: x[:, :0], r"x = shape \(90, 0\)"),
    ],
)
def test_states_that_are_none_are_refused(rings: tuple[Arrays, ...], spoilt: Any, message: str) -> None:
    x, z, _ = rings
    with pytest.raises(ParameterError, match=f"^{message}"):
        SafeRegion(state_max=None).fit(spoilt(x), z)


def test_weights_that_are_all_zero_are_refused(rings: tuple[Arrays, ...]) -> None:
    x, z, paths = rings
    with pytest.raises(ParameterError, match=r"^sample_weight = .*not all zero"):
        SafeRegion(state_max=None).fit(x, z, paths, np.zeros(90))
