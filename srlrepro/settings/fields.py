"""Parameters that know their unit, their allowed values and where they come from.

This module, `paper`, `choices` and `config` need only the standard library, so that a command line can be
checked before anything is installed.
"""

import math
from dataclasses import field, fields
from typing import Any

LONGEST, LONGEST_MESSAGE = 200, 2000  # characters of a value that a message repeats, and of a message
LARGEST_WHOLE = 2**53  # up to here floating-point numbers tell whole numbers apart


def one_line(value: object, longest: int = LONGEST) -> str:
    """A value or a message as one line: what cannot be printed is escaped, what is too long is cut."""
    try:
        text = str(value)
    except ValueError:  # Python writes no whole number of more than 4300 digits
        text = "a whole number of thousands of digits"
    cut = text[:longest] + ("…" if len(text) > longest else "")
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in cut)


class ParameterError(ValueError):
    """A parameter has a value that is not allowed; the message is one line."""

    def __init__(self, message: object) -> None:
        super().__init__(one_line(message, LONGEST_MESSAGE))


def check(ok: bool, name: str, value: object, allowed: str) -> None:
    """Raise `ParameterError` naming the parameter, its value and what is allowed, unless ``ok``."""
    if not ok:
        raise ParameterError(f"{one_line(name)} = {one_line(value)}: must be {allowed}")


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
        if numeric and isinstance(value, int):
            check(abs(value) <= LARGEST_WHOLE, f.name, value, f"{kind} {allowed}, at most {LARGEST_WHOLE}")
        low, high = (float(bound) for bound in allowed[1:-1].split(","))
        ok = (
            numeric
            and math.isfinite(value)
            and (value >= low if allowed[0] == "[" else value > low)
            and (value <= high if allowed[-1] == "]" else value < high)
        )
        check(ok, f.name, value, f"{kind} {allowed}")


def check_whole(name: str, value: Any, least: int, most: int = LARGEST_WHOLE) -> None:
    """Raise `ParameterError` unless a value is a whole number between two others."""
    whole = isinstance(value, int) and not isinstance(value, bool)
    check(whole and least <= value <= most, name, value, f"a whole number in [{least}, {most}]")
