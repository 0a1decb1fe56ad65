"""Every number of a replication: what the paper states (`Paper`) and what we chose (`Choices`)."""

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
        """Some fields of either class replaced; `ParameterError`: an unknown name, or a value not allowed."""
        for name, value in values.items():
            check(name in PARAMETERS, name, value, "left out: there is no such parameter")
        stated = {f.name: values.pop(f.name) for f in fields(Paper) if f.name in values}
        return Config(replace(self.paper, **stated), replace(self.choices, **values))

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
    """The value of a parameter that is written as ``text``; `ParameterError` if it is not of its type."""
    check(name in PARAMETERS, name, text, "left out: there is no such parameter")
    kind = PARAMETERS[name].type
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
        ParameterError: no ``=``, an unknown name, a name given twice, or a value that is not allowed.
    """
    values: dict[str, Any] = {}
    for setting in settings:
        name, equals, text = setting.partition("=")
        check(equals == "=", "--set", setting, "of the form NAME=VALUE")
        check(name not in values, "--set", setting, f"the only value of {one_line(name)}")
        values[name] = parse_value(name, text)
    Config().with_values(**values)
    return values
