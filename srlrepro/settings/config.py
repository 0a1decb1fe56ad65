"""Every number of a replication: what the paper states (`Paper`) and what we chose (`Choices`).

Default, bounds, unit and source of a parameter stand in these two classes alone. `Config.with_values` varies
any of them without editing code.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from inspect import signature
from typing import Any

from srlrepro.settings.choices import Choices
from srlrepro.settings.fields import STAGES, ParameterError, check, check_field, one_line
from srlrepro.settings.paper import Paper

PARAMETERS = {f.name: f for part in (Paper, Choices) for f in fields(part)}


def check_parameters(values: Mapping[str, Any]) -> None:
    """Raise `ParameterError` if one of the values, by name, is not allowed; names of no parameter pass."""
    for name in PARAMETERS.keys() & values.keys():
        check_field(PARAMETERS[name], values[name])


@dataclass(frozen=True)
class Config:
    """All values of one replication."""

    paper: Paper = Paper()
    choices: Choices = Choices()

    def with_values(self, /, **values: Any) -> "Config":
        """A configuration with some fields of either class replaced.

        Raises:
            ParameterError: an unknown name or a value that is not allowed.
        """
        for name, value in values.items():
            check(name in PARAMETERS, name, value, "left out: there is no such parameter")
        stated = {f.name for f in fields(Paper)}
        return Config(
            replace(self.paper, **{n: v for n, v in values.items() if n in stated}),
            replace(self.choices, **{n: v for n, v in values.items() if n not in stated}),
        )

    def as_dict(self) -> dict[str, Any]:
        """{name: value} of every parameter."""
        return asdict(self.paper) | asdict(self.choices)

    def until(self, stage: str) -> dict[str, Any]:
        """{name: value} of the parameters that the results of a stage depend on."""
        stages = list(STAGES)[: list(STAGES).index(stage) + 1]
        return {n: v for n, v in self.as_dict().items() if PARAMETERS[n].metadata["stage"] in stages}

    def arguments_of(self, function: Callable[..., Any]) -> dict[str, Any]:
        """{name: value} of the parameters that a function or a class takes under the same name."""
        return {n: v for n, v in self.as_dict().items() if n in signature(function).parameters}


def parse_value(name: str, text: str) -> Any:
    """The value of the field ``name`` written as ``text`` on a command line.

    Raises:
        ParameterError: an unknown name, or a text that is not of the field's type.
    """
    check(name in PARAMETERS, name, text, "left out: there is no such parameter")
    kind = PARAMETERS[name].type
    if kind is str:
        return text
    if kind is bool:
        check(text in ("true", "false"), name, text, "true or false")
        return text == "true"
    try:
        return kind(text)  # type: ignore[operator]
    except ValueError:
        raise ParameterError(
            f"{name} = {one_line(text)}: must be a {'whole ' if kind is int else ''}number"
        ) from None


def parse_settings(settings: Iterable[str]) -> dict[str, Any]:
    """{name: value} of texts such as ``k=500``.

    Raises:
        ParameterError: a text without ``=``, an unknown name, a name given twice, or a value that is not
            allowed.
    """
    values: dict[str, Any] = {}
    for setting in settings:
        name, equals, text = setting.partition("=")
        check(equals == "=", "--set", setting, "of the form NAME=VALUE")
        check(name not in values, "--set", setting, f"the only value of {one_line(name)}")
        values[name] = parse_value(name, text)
    Config().with_values(**values)
    return values
