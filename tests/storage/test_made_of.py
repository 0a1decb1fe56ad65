"""What files say of what they were made of: every parameter's stage, what comes back, what is refused."""

import hashlib
import json
from collections.abc import Callable, Iterator
from dataclasses import Field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from srlrepro.dynamics.pendulum import Floats
from srlrepro.region import safe_region
from srlrepro.region.safe_region import SafeRegion, learn_region
from srlrepro.samplers import TrainingData, generate
from srlrepro.settings.config import PARAMETERS, Config
from srlrepro.settings.fields import STAGES, ParameterError
from srlrepro.storage.files import ResultError, write_arrays
from srlrepro.storage.made_of import MadeOf, read_made_of, require_made_of, write_made_of

BASE = Config().with_values(k=60, random_rollouts=20, gamma_cells=16)
TELLING = {  # where the usual variation is too small to change one of few labels
    "n_minibatches": 64,
    "n_steps": 4096,
    "lqr_angle_weight": 1.0,
    "lqr_rate_weight": 100.0,
    "lqr_torque_weight": 1.0,
    "torque_noise": 0.01,
    "angle_noise": 1.0,
    "rate_noise": 100.0,
    "recovery_horizon": 0.3,
    "recovered_angle": 1e-9,
    "recovered_rate": 1e-9,
    "rate_bound": 50.0,
}


@pytest.fixture(scope="module", autouse=True)
def quick_embedding() -> Iterator[None]:
    """In place of t-SNE, which takes a second: some other function of all that t-SNE is given."""

    def embed(omega: Floats, perplexity: float, seed: int) -> Floats:
        return omega[:, :2] + perplexity * np.arange(len(omega))[:, None] + seed

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(safe_region, "embed", embed)
        yield


def other(field: "Field[Any]") -> Any:
    """Another allowed value of a parameter."""
    name, value = field.name, BASE.as_dict()[field.name]
    if name in TELLING:
        return TELLING[name]
    if name == "links":
        return value - 1  # more would leave the state space at once
    if field.type is bool:
        return not value
    if field.type is str:
        return next(word for word in field.metadata["allowed"].split("|") if word != value)
    if field.type is int:
        return value + 1
    return 0.9 * value if value else 0.05


def digests(config: Config) -> tuple[str, str]:
    """Of training data, and of the region learned from them."""
    data, digest = generate(0.5, config, 0), hashlib.sha256()
    for part in (data.x, data.z, data.mnd.mean, data.mnd.covariance):
        digest.update(part.tobytes())
    return digest.hexdigest(), learn_region(data, config).digest()


@pytest.fixture(scope="module")
def usual() -> tuple[str, str]:
    return digests(BASE)


@pytest.mark.parametrize("name", PARAMETERS)
def test_data_and_regions_depend_on_what_the_stages_say(name: str, usual: tuple[str, str]) -> None:
    field = PARAMETERS[name]
    needed = {"random_law": "normal"} if name == "random_std" else {}
    before = digests(BASE.with_values(**needed)) if needed else usual
    varied = digests(BASE.with_values(**needed, **{name: other(field)}))
    changed = [found != own for found, own in zip(varied, before, strict=True)]
    stage = list(STAGES).index(field.metadata["stage"])
    assert changed == [stage <= list(STAGES).index(made) for made in ("data", "region")]


def test_the_stages_grow() -> None:
    known: dict[str, Any] = {}
    for stage in STAGES:
        more = Config().until(stage)
        assert known.items() < more.items()
        known = more
    assert known == Config().as_dict()


def test_files_carry_what_they_were_made_of(tmp_path: Path) -> None:
    config = BASE.with_values(gravity=9.0, p_t=0.7, label_gap=0.5, total_steps=5)
    data = generate(0.25, config, seed=7)
    data.save(tmp_path / "data.npz")
    back = TrainingData.load(tmp_path / "data.npz")
    assert back.made_of == data.made_of == MadeOf(0.25, 7, config.until("data"))
    region = learn_region(back, config, seed=3)
    region.save(tmp_path / "region.npz")
    loaded = SafeRegion.load(tmp_path / "region.npz")
    assert loaded.made_of_ == region.made_of_ == MadeOf(0.25, 7, config.until("region"))
    assert loaded.made_of_ is not None and loaded.made_of_.values["p_t"] == 0.7


def test_what_is_made_by_hand_says_nothing(tmp_path: Path, example: tuple[Floats, ...]) -> None:
    data = replace(generate(0.5, BASE, 0), made_of=None)
    data.save(tmp_path / "data.npz")
    assert TrainingData.load(tmp_path / "data.npz").made_of is None
    for region in (learn_region(data, BASE), SafeRegion().fit_embedding(*example)):
        region.save(tmp_path / "region.npz")
        assert region.made_of_ is SafeRegion.load(tmp_path / "region.npz").made_of_ is None
        with pytest.raises(ParameterError, match=r"^region = FILE: must be one that says"):
            require_made_of(region.made_of_, BASE, "region", where="FILE")


def test_a_region_that_is_changed_or_fitted_anew_says_no_more_what_it_was_made_of(
    tmp_path: Path, example: tuple[Floats, ...]
) -> None:
    region = learn_region(generate(0.5, BASE, 0), BASE)
    region.set_params(p_t=0.5).save(tmp_path / "region.npz")
    assert SafeRegion.load(tmp_path / "region.npz").made_of_ is None
    assert region.fit_embedding(*example).made_of_ is None


ASKED: dict[str, tuple[str, dict[str, Any], str]] = {  # stage, what is asked for, what the refusal says
    "α": ("region", {"alpha": 1.0}, "alpha = 1.0: must be 0.5, "),
    "seed": ("region", {"seed": 1}, "seed = 1: must be 0, "),
    "physics": ("data", {"gravity": 9.0}, "gravity = 9.0: must be 9.81, "),
    "data": ("data", {"k": 61}, "k = 61: must be 60, "),
    "data, of a region": ("region", {"mnd_outside": "redraw"}, "mnd_outside = redraw: must be keep, "),
    "region": ("region", {"p_t": 0.5}, "p_t = 0.5: must be 0.8, "),
    "origin": ("region", {"known_origin": False}, "known_origin = False: must be True, "),
}
ALIKE: list[tuple[str, dict[str, Any]]] = [
    ("data", {"p_t": 0.5, "alpha": 0.5, "seed": 0}),
    ("region", {"trial_length": 2.0, "n_epochs": 1, "checkpoint_updates": 1}),
    ("region", {}),
]


def refusal(stage: str, asked: dict[str, Any]) -> str:
    """What a reader that asks for this says to a file of a stage; nothing if it takes the file."""
    made_of = MadeOf(0.5, 0, BASE.until(stage))
    of_data = {name: value for name, value in asked.items() if name in ("alpha", "seed")}
    config = BASE.with_values(**{name: value for name, value in asked.items() if name not in of_data})
    try:
        require_made_of(made_of, config, stage, where="FILE", **of_data)
    except ParameterError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("case", ASKED)
def test_a_difference_is_refused_in_one_line(case: str) -> None:
    stage, asked, words = ASKED[case]
    assert refusal(stage, asked) == f"{words}with which FILE was made"


@pytest.mark.parametrize(("stage", "asked"), ALIKE)
def test_what_a_stage_does_not_depend_on_may_differ(stage: str, asked: dict[str, Any]) -> None:
    assert refusal(stage, asked) == ""


def test_data_of_other_values_give_no_region() -> None:
    data = generate(0.5, BASE, 0)
    with pytest.raises(ParameterError, match=r"gravity = 9\.0: must be 9\.81, "):
        learn_region(data, BASE.with_values(gravity=9.0))


Told = dict[str, Any]
LIES: dict[str, Callable[[Told], object]] = {
    "no JSON": lambda told: "{",
    "a list": lambda told: [told],
    "a number": lambda told: 1,
    "no seed": lambda told: {"alpha": told["alpha"], "values": told["values"]},
    "more": lambda told: told | {"more": 1},
    "α": lambda told: told | {"alpha": 2},
    "α, a text": lambda told: told | {"alpha": "0"},
    "seed": lambda told: told | {"seed": -1},
    "values": lambda told: told | {"values": [1]},
    "a value": lambda told: told | {"values": told["values"] | {"k": "x"}},
    "an unknown value": lambda told: told | {"values": told["values"] | {"q": 1}},
    "a value of another stage": lambda told: told | {"values": told["values"] | {"p_t": 0.7}},
    "a value less": lambda told: told | {"values": {n: v for n, v in told["values"].items() if n != "k"}},
}


@pytest.mark.parametrize("lie", LIES)
def test_a_file_that_does_not_say_it_well_is_refused(lie: str, tmp_path: Path) -> None:
    path, data = tmp_path / "data.npz", generate(0.5, BASE, 0)
    told = json.loads(write_made_of(data.made_of))
    assert read_made_of(json.dumps(told), "data", path) == data.made_of
    data.save(path)
    with np.load(path) as archive:
        stored = {key: value for key, value in archive.items() if key not in ("format", "made_of")}
    spoilt = LIES[lie](told)
    text = spoilt if isinstance(spoilt, str) else json.dumps(spoilt)
    write_arrays(path, "srlrepro-training-data-2", **stored, made_of=text)
    with pytest.raises(ResultError, match=r"data\.npz does not say well what it was made of: ") as refusal:
        TrainingData.load(path)
    assert "\n" not in str(refusal.value)
