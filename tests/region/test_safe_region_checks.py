"""The safe region as a file and as an estimator: what comes back and what is refused."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from learned import Learned
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.model_selection import GridSearchCV

from srlrepro.dynamics.pendulum import Floats
from srlrepro.region.mapping import Network
from srlrepro.region.safe_region import FORMAT, SafeRegion
from srlrepro.settings.config import PARAMETERS, Config
from srlrepro.settings.fields import ParameterError
from srlrepro.storage.files import ResultError, write_arrays

Draw = Callable[..., Floats]
HIGH = np.array(Config().paper.state_max)


def test_a_saved_region_predicts_the_same(small: Learned, draw: Draw, tmp_path: Path) -> None:
    region, x = small[1], draw(500)
    region.save(tmp_path / "region.npz")
    back = SafeRegion.load(tmp_path / "region.npz")
    assert back.get_params() == region.get_params()
    for method in ("transform", "predict_proba", "predict"):
        np.testing.assert_array_equal(getattr(back, method)(x), getattr(region, method)(x))
    for name in ("embedding_", "evidence_", "labels_", "classes_"):
        np.testing.assert_array_equal(getattr(back, name), getattr(region, name))


def test_a_region_is_shown_as_scikit_learn_shows_it() -> None:
    """By the parameters that differ from the defaults."""
    assert repr(SafeRegion(p_t=0.6, psi="neighbours")) == "SafeRegion(p_t=0.6, psi='neighbours')"


def test_truncated_and_foreign_files_are_refused(small: Learned, tmp_path: Path) -> None:
    path = tmp_path / "region.npz"
    small[1].save(path)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(ResultError, match=r"region\.npz"):
        SafeRegion.load(path)
    small[0].save(path)  # training data
    with pytest.raises(ResultError, match=r"region\.npz"):
        SafeRegion.load(path)
    with pytest.raises(ResultError, match="missing"):
        SafeRegion.load(tmp_path / "absent.npz")


@pytest.mark.parametrize(("value", "fits"), [(0.0, True), (1 - 2**-53, True), (1.0, False), (-1e-300, False)])
def test_gamma_is_a_probability_below_one(small: Learned, tmp_path: Path, value: float, fits: bool) -> None:
    small[1].save(path := tmp_path / "region.npz")
    with np.load(path) as archive:
        stored = {key: part for key, part in archive.items() if key != "format"}
    stored["array_gamma"][0, 0] = value
    write_arrays(path, FORMAT, **stored)
    if fits:
        assert SafeRegion.load(path).arrays_.gamma[0, 0] == value
    else:
        with pytest.raises(ResultError, match="parts do not fit together"):
            SafeRegion.load(path)


SPOILS: dict[str, tuple[Callable[[Any], bool], Callable[[Any], Any]]] = {
    "an entry too few": (lambda v: v.ndim > 0, lambda v: v[:-1]),
    "a dimension too few": (lambda v: v.ndim > 0, lambda v: v[0]),
    "NaN": (lambda v: v.dtype.kind == "f", lambda v: np.nan * v),
    "text instead of numbers": (lambda v: v.dtype.kind in "if", lambda v: np.array("text")),
    "minus one": (lambda v: v.dtype.kind in "if", lambda v: 0 * v - 1),
}
MAY_BE_NEGATIVE = {
    *(f"array_{name}" for name in Network._fields),
    "array_x_train",
    "array_y_train",
    "array_origin",
    "evidence",
    "param_random_state",
}


@pytest.mark.parametrize("spoil", SPOILS)
def test_parts_that_do_not_fit_together_are_refused(small: Learned, tmp_path: Path, spoil: str) -> None:
    path, accepted = tmp_path / "region.npz", []
    applies, change = SPOILS[spoil]
    small[1].save(path)
    with np.load(path) as archive:
        stored = {key: value for key, value in archive.items() if key != "format"}
    names = [name for name in stored if applies(stored[name])]
    for name in [n for n in names if spoil != "minus one" or n not in MAY_BE_NEGATIVE]:
        write_arrays(path, FORMAT, **{**stored, name: change(stored[name])})
        try:
            SafeRegion.load(path)
            accepted.append(name)
        except ResultError as error:
            assert str(path) in str(error)
    assert names
    assert accepted == []


BAD_PARAMETERS: dict[str, list[Any]] = {
    "p_t": [0.0, 1.0, -0.5, 1.5, np.nan, "0.8", None],
    "label_gap": [-0.1, 10.5],
    "perplexity": [0.5, np.inf],
    "psi_neighbours": [0, -1, 2.5, 201, True, np.float64(3.0)],
    "gamma_bandwidth": [0.0, -0.1, np.nan, 1.5],
    "gamma_prior": [0.0, -1.0, np.nan, 1.5],
    "psi": ["linear"],
    "psi_width": [0, 1.5, 1025],
    "psi_penalty": [-1.0, np.inf],
    "gamma_empty": [-0.1, 1.0],
    "gamma_cells": [0, -3, 7, 1025],
    "gamma_evidence": ["elsewhere"],
    "state_max": [(0.0, *HIGH[1:]), (), list(HIGH)],
    "random_state": [-1, 2**32, 0.5, None],
}


@pytest.mark.parametrize(("name", "value"), [(n, v) for n, values in BAD_PARAMETERS.items() for v in values])
def test_bad_parameters_are_refused_by_name(example: tuple[Floats, ...], name: str, value: object) -> None:
    with pytest.raises(ValueError, match=f"{name} = "):
        SafeRegion(**{name: value}).fit_embedding(*example)


def test_bounds_are_those_of_the_configuration(example: tuple[Floats, ...]) -> None:
    for name in SafeRegion.from_config(Config()).get_params().keys() & PARAMETERS.keys():
        for value in ("x", -1e9, 1e9):
            with pytest.raises(ParameterError) as by_config:
                Config().with_values(**{name: value})
            with pytest.raises(ParameterError) as by_region:
                SafeRegion(**{name: value}).fit_embedding(*example)
            assert str(by_region.value) == str(by_config.value)


def test_numbers_of_numpy_are_numbers(example: tuple[Floats, ...], tmp_path: Path) -> None:
    """A grid search hands them over."""
    values = {"psi_neighbours": 5, "gamma_cells": 20, "gamma_bandwidth": 0.5, "p_t": 0.25, "random_state": 3}
    plain = SafeRegion(**values).fit_embedding(*example)
    given = {n: np.int64(v) if isinstance(v, int) else np.float32(v) for n, v in values.items()}
    region = SafeRegion(**given).fit_embedding(*example)
    np.testing.assert_array_equal(region.safety(example[0]), plain.safety(example[0]))
    region.save(tmp_path / "region.npz")
    assert SafeRegion.load(tmp_path / "region.npz").get_params() == plain.get_params()
    found = GridSearchCV(
        _Embedded(), {"psi_neighbours": np.array([1, 3]), "p_t": np.linspace(0.2, 0.4, 2)}, cv=2
    )
    assert found.fit(*example[:2]).best_params_["psi_neighbours"] in (1, 3)


class _Embedded(SafeRegion):
    """A region whose y are the first two coordinates, so that it needs no trajectories."""

    def fit(self, x: Floats, z: Floats) -> "_Embedded":  # type: ignore[override]
        self.fit_embedding(x, z, x[:, :2])
        return self


def test_bad_training_data_are_refused_by_name(example: tuple[Floats, ...]) -> None:
    x, z, y = example
    spoilt = np.where(x > x.min(), x, np.nan)
    cases = [
        (spoilt, z, y, "x"),
        (x[:, :5], z, y, "x"),
        (x, z[:-1], y, "z"),
        (x, z + 1, y, "z"),
        (x, np.where(z == 1, np.nan, 0.0), y, "z"),
        (x, z, y[:-1], "y"),
        (x, z, y[:, :1], "y"),
        (x[:1], z[:1], y[:1], "k"),
    ]
    for *data, name in cases:
        with pytest.raises(ValueError, match=f"^{name} = "):
            SafeRegion().fit_embedding(*data)


def test_a_single_state_is_no_dataset(example: tuple[Floats, ...]) -> None:
    with pytest.raises(ValueError, match=r"^k = 1"):
        SafeRegion().fit(example[0][:1], [1], np.zeros((1, 5, 6)))


def test_sklearns_conventions(example: tuple[Floats, ...]) -> None:
    region = SafeRegion(p_t=0.7, psi_neighbours=3)
    assert region.get_params()["p_t"] == 0.7
    assert clone(region).get_params() == region.get_params()
    assert region.set_params(gamma_prior=0.5) is region
    assert region.gamma_prior == 0.5
    for call in (region.transform, region.safety, region.predict_proba, region.predict, region.save):
        with pytest.raises(NotFittedError):
            call(np.zeros((1, 6)))
    assert region.fit_embedding(*example) is region
    np.testing.assert_array_equal(region.classes_, [0, 1])
    assert region.score(example[0], region.predict(example[0])) == 1.0
    with pytest.raises(NotFittedError):
        clone(region).predict(example[0])
