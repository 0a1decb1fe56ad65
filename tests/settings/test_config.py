"""The configuration: every value has its source, every bad value a message, and nothing changes in place."""

import itertools
import json
import math
from collections.abc import Iterator
from dataclasses import FrozenInstanceError, fields
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from srlrepro.settings.choices import Choices
from srlrepro.settings.config import Config, check_parameters, parse_settings, parse_value
from srlrepro.settings.fields import STAGES, ParameterError, check
from srlrepro.settings.paper import Paper

FIELDS = [f for part in (Paper, Choices) for f in fields(part)]
NUMBERS = [f for f in FIELDS if f.type in (int, float)]
NAMES = [f for f in FIELDS if f.type is str]
SWITCHES = [f for f in FIELDS if f.type is bool]


def by_name(field: Any) -> str:
    return str(getattr(field, "name", field))


def bounds(field: Any) -> tuple[float, float]:
    low, high = field.metadata["allowed"][1:-1].split(",")
    return float(low), float(high)


def outside(field: Any) -> Iterator[Any]:
    """Values of a numeric field that are not allowed."""
    allowed, (low, high) = field.metadata["allowed"], bounds(field)
    yield from (math.nan, math.inf, -math.inf, "1", None, True)
    for end, is_open, sign in ((low, allowed[0] == "(", -1), (high, allowed[-1] == ")", 1)):
        if math.isfinite(end):
            beyond = 1 if field.type is int else 1e-9 * max(1.0, abs(end))
            yield field.type(end) + sign * beyond
            if is_open:
                yield field.type(end)
    if field.type is int:
        yield float(field.default)


@pytest.mark.parametrize("field", FIELDS, ids=by_name)
def test_every_value_has_a_meaning_a_unit_and_a_source(field: Any) -> None:
    source = "place" if field in fields(Paper) else "reason"
    assert set(field.metadata) == {"stage", "allowed", "unit", "meaning", source}
    assert field.metadata["stage"] in STAGES
    for key in ("allowed", "meaning", source):
        assert field.metadata[key].strip()
        assert "TODO" not in field.metadata[key]


def test_no_name_is_used_twice() -> None:
    assert len({f.name for f in FIELDS}) == len(FIELDS)


@pytest.mark.parametrize("field", NUMBERS, ids=by_name)
def test_a_bad_number_is_refused_in_one_line(field: Any) -> None:
    kind = "whole number" if field.type is int else "number"
    for value in outside(field):
        with pytest.raises(ParameterError) as caught:
            Config().with_values(**{field.name: value})
        assert str(caught.value) == f"{field.name} = {value}: must be a {kind} in {field.metadata['allowed']}"


@pytest.mark.parametrize("field", NUMBERS, ids=by_name)
def test_the_ends_of_an_interval_are_allowed_where_it_says_so(field: Any) -> None:
    allowed = field.metadata["allowed"]
    for closed, end in zip((allowed[0] == "[", allowed[-1] == "]"), bounds(field), strict=True):
        if closed and field.name not in ("n_steps", "n_minibatches"):  # they must fit each other
            value = field.type(end)
            assert getattr(type_of(field)(**{field.name: value}), field.name) == value


def type_of(field: Any) -> type:
    return Paper if field in fields(Paper) else Choices


@pytest.mark.parametrize("field", [*NAMES, *SWITCHES], ids=by_name)
def test_other_words_and_switches_are_refused_in_one_line(field: Any) -> None:
    allowed = field.metadata["allowed"].split("|")
    for value in ("", "other", 1, None, "true "):
        with pytest.raises(ParameterError) as caught:
            Config().with_values(**{field.name: value})
        message = str(caught.value)
        assert message.startswith(f"{field.name} = {value}: must be ")
        assert all(word in message for word in allowed)
        assert "\n" not in message
    for word in allowed:
        value = word if field in NAMES else word == "true"
        assert Config().with_values(**{field.name: value}).as_dict()[field.name] == value


def test_minibatches_divide_the_steps_of_an_update() -> None:
    for steps, batches in ((100, 3), (64, 64), (64, 128)):
        with pytest.raises(ParameterError, match=f"n_minibatches = {batches}: must be a proper divisor"):
            Config().with_values(n_steps=steps, n_minibatches=batches)
    assert Config().with_values(n_steps=100, n_minibatches=4).paper.n_steps == 100


def test_the_papers_values_are_those_of_the_paper() -> None:
    paper = Paper()
    assert (paper.links, paper.length, paper.mass, paper.torque_limit) == (3, 3.0, 3.0, 100.0)
    assert (paper.circle_height, paper.circle_radius, paper.circle_speed) == (2.7, 0.3, math.pi)
    assert paper.state_max == (math.pi / 2, math.pi, math.pi, 10.0, 20.0, 20.0)
    assert Paper(links=1).state_max == (math.pi / 2, 10.0)
    assert Paper(links=4).state_max == (math.pi / 2, *[math.pi] * 3, 10.0, *[20.0] * 3)
    assert (paper.k, paper.p_t, paper.reward_constant, paper.reward_slope) == (1000, 0.8, 2.0, 10.0)
    assert (paper.n_steps, paper.n_minibatches, paper.n_epochs) == (2048, 128, 10)
    assert (paper.learning_rate, paper.vf_coef, paper.max_grad_norm, paper.ent_coef) == (1e-4, 1.0, 10.0, 0.0)
    assert (paper.discount, paper.gae_lambda) == (0.99, 0.95)
    assert (paper.hidden_layers, paper.hidden_width) == (2, 128)


def test_a_configuration_does_not_change() -> None:
    config = Config()
    for part, name in ((config, "paper"), (config.paper, "k"), (config.choices, "gravity")):
        with pytest.raises(FrozenInstanceError):
            setattr(part, name, 1)
    other = config.with_values(k=7, gravity=1.6)
    assert (other.paper.k, other.choices.gravity) == (7, 1.6)
    assert config == Config()
    differing = {name for name, value in other.as_dict().items() if value != config.as_dict()[name]}
    assert differing == {"k", "gravity"}
    assert set(other.as_dict()) == {f.name for f in FIELDS}
    assert hash(config) == hash(Config())


def test_an_unknown_name_is_refused() -> None:
    for call in (
        lambda: Config().with_values(speed=3),
        lambda: parse_value("speed", "3"),
        lambda: parse_settings(["speed=3"]),
    ):
        with pytest.raises(
            ParameterError, match=r"^speed = 3: must be left out: there is no such parameter$"
        ):
            call()


@pytest.mark.parametrize("field", FIELDS, ids=by_name)
def test_every_default_survives_being_written_and_parsed(field: Any) -> None:
    text = str(field.default).lower() if field in SWITCHES else str(field.default)
    value = parse_value(field.name, text)
    assert value == field.default
    assert type(value) is field.type
    assert parse_settings([f"{field.name}={text}"]) == {field.name: field.default}


@pytest.mark.parametrize("field", SWITCHES, ids=by_name)
def test_a_switch_is_what_its_word_says(field: Any) -> None:
    for word, value in (("true", True), ("false", False)):
        assert parse_value(field.name, word) is value
        assert parse_settings([f"{field.name}={word}"]) == {field.name: value}


def test_numbers_of_other_libraries_become_pythons_own() -> None:
    config = Config().with_values(k=np.int64(7), p_t=np.float32(0.5), gravity=Fraction(39, 4))
    assert json.loads(json.dumps(config.as_dict())) == config.as_dict()
    assert (config.paper.k, config.paper.p_t, config.choices.gravity) == (7, 0.5, 9.75)


def test_classes_check_and_take_the_parameters_that_they_name() -> None:
    class Thing:
        def __init__(self, k: int, gravity: float, speed: float = 0.0) -> None: ...

    assert Config().arguments_of(Thing) == {"k": 1000, "gravity": 9.81}
    check_parameters({"k": 7, "speed": "any"})
    with pytest.raises(ParameterError, match=r"^k = 1: must be a whole number in"):
        check_parameters({"k": 1, "speed": "any"})


def test_several_settings_are_taken_together() -> None:
    found = parse_settings(
        ["n_steps=64", "n_minibatches=4", "early_stop=truncate", "data_per_seed=true", "p_t=.5"]
    )
    expected = {
        "n_steps": 64,
        "n_minibatches": 4,
        "early_stop": "truncate",
        "data_per_seed": True,
        "p_t": 0.5,
    }
    assert found == expected
    assert parse_settings([]) == {}


BAD_SETTINGS = {
    "k": "--set = k: must be of the form NAME=VALUE",
    "": "--set = : must be of the form NAME=VALUE",
    "=3": " = 3: must be left out",
    "k=": "k = : must be a whole number",
    "k=5 k=6": "--set = k=6: must be the only value of k",
    "k=2.5": "k = 2.5: must be a whole number",
    "k=1e3": "k = 1e3: must be a whole number",
    "k=1": "k = 1: must be a whole number in [",
    "p_t=high": "p_t = high: must be a number",
    "p_t=nan": "p_t = nan: must be a number in (0, 1)",
    "p_t=1": "p_t = 1.0: must be a number in (0, 1)",
    "data_per_seed=yes": "data_per_seed = yes: must be true or false",
    "early_stop=never": "early_stop = never: must be one of terminate, truncate",
    "n_steps=100": "n_minibatches = 128: must be a proper divisor of n_steps = 100",
}


@pytest.mark.parametrize("text", BAD_SETTINGS)
def test_a_bad_setting_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(ParameterError) as caught:
        parse_settings(text.split(" ") if text.count("=") > 1 else [text])
    assert str(caught.value).startswith(BAD_SETTINGS[text])
    assert "\n" not in str(caught.value)


def test_check_passes_or_names_what_is_wrong() -> None:
    check(True, "a", 1, "2")
    with pytest.raises(ValueError, match=r"^a = 1: must be 2$"):
        check(False, "a", 1, "2")


def test_the_intervals_are_well_formed() -> None:
    for field, (first, last) in itertools.product(NUMBERS, [("([", ")]")]):
        allowed = field.metadata["allowed"]
        assert allowed[0] in first
        assert allowed[-1] in last
        low, high = bounds(field)
        assert low < high
        assert low <= field.default <= high
