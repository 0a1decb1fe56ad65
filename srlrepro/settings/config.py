"""Every number of a replication: what the paper states (`Paper`) and what we chose (`Choices`).

`Config.with_values` varies any of them without editing code; the ledger in the README is printed from the
two classes.
"""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

from srlrepro.settings.choices import Choices
from srlrepro.settings.fields import ParameterError, check, one_line
from srlrepro.settings.paper import Paper

__all__ = [
    "Choices",
    "Config",
    "Paper",
    "ParameterError",
    "check",
    "one_line",
    "parse_settings",
    "parse_value",
]


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
        paper, choices = ({f.name for f in fields(c)} for c in (Paper, Choices))
        for name, value in values.items():
            check(name in paper | choices, name, value, "left out: there is no such parameter")
        return Config(
            replace(self.paper, **{n: v for n, v in values.items() if n in paper}),
            replace(self.choices, **{n: v for n, v in values.items() if n in choices}),
        )

    def as_dict(self) -> dict[str, Any]:
        """{name: value} of every field."""
        return asdict(self.paper) | asdict(self.choices)


def parse_value(name: str, text: str) -> Any:
    """The value of the field ``name`` written as ``text`` on a command line.

    Raises:
        ParameterError: an unknown name, or a text that is not of the field's type.
    """
    types = {f.name: f.type for c in (Paper, Choices) for f in fields(c)}
    check(name in types, name, text, "left out: there is no such parameter")
    if types[name] is str:
        return text
    if types[name] is bool:
        check(text in ("true", "false"), name, text, "true or false")
        return text == "true"
    try:
        return types[name](text)  # type: ignore[operator]
    except ValueError:
        raise ParameterError(
            f"{name} = {one_line(text)}: must be a {'whole ' if types[name] is int else ''}number"
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
