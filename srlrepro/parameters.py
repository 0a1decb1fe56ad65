"""Parameters that know their unit, their allowed values and where they come from.

This module, `paper`, `choices` and `config` need only the standard library, so that a command line can be
checked before anything is installed.
"""

import math
from dataclasses import field, fields
from typing import Any


class ParameterError(ValueError):
    """A parameter has a value that is not allowed; the message is one line."""


def check(ok: bool, name: str, value: object, allowed: str) -> None:
    """Raise `ParameterError` naming the parameter, its value and what is allowed, unless ``ok``."""
    if not ok:
        raise ParameterError(f"{name} = {value}: must be {allowed}")


def stated(default: Any, allowed: str, unit: str, meaning: str, place: str) -> Any:
    """A field of `Paper`; ``allowed`` is an interval such as ``(0, 1]``, or names separated by ``|``."""
    return field(
        default=default, metadata={"allowed": allowed, "unit": unit, "meaning": meaning, "place": place}
    )


def chosen(default: Any, allowed: str, unit: str, meaning: str, reason: str) -> Any:
    """A field of `Choices`; as `stated`, with the reason of the choice instead of a place."""
    return field(
        default=default, metadata={"allowed": allowed, "unit": unit, "meaning": meaning, "reason": reason}
    )


def check_fields(values: Any) -> None:
    for f in fields(values):
        value, allowed = getattr(values, f.name), f.metadata["allowed"]
        if f.type is str:
            check(value in allowed.split("|"), f.name, value, f"one of {allowed.replace('|', ', ')}")
            continue
        if f.type is bool:
            check(isinstance(value, bool), f.name, value, "true or false")
            continue
        whole = f.type is int
        kind = "a whole number in" if whole else "a number in"
        numeric = isinstance(value, int if whole else (int, float)) and not isinstance(value, bool)
        low, high = (float(bound) for bound in allowed[1:-1].split(","))
        ok = (
            numeric
            and math.isfinite(value)
            and (value >= low if allowed[0] == "[" else value > low)
            and (value <= high if allowed[-1] == "]" else value < high)
        )
        check(ok, f.name, value, f"{kind} {allowed}")
