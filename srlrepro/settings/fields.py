"""Parameters that know their stage, unit, allowed values and where they come from.

The settings need only the standard library, so that a command line is checked before anything slow is loaded.
"""

import math
from dataclasses import Field, field, fields
from numbers import Integral, Real
from typing import Any

STAGES = {  # in their order: what is made there; a parameter has the first stage that depends on it
    "physics": "the pendulum under K, and all that follows",
    "data": "the training data, and all that follows",
    "region": "Ψ, Γ and S_y, and the training runs under them",
    "task": "the learner's environment and its supervisor, and so the training runs",
    "learner": "the training runs alone",
    "none": "no result",
}
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


def is_number(value: Any, whole: bool = False) -> bool:
    """Whether a value is a number, Python's or of another library; a truth value is none."""
    return not isinstance(value, bool) and isinstance(value, Integral if whole else Real)


def stated(stage: str, default: Any, allowed: str, unit: str, meaning: str, place: str) -> Any:
    """A field of `Paper`; ``allowed`` is an interval such as ``(0, 1]``, or names separated by ``|``."""
    known = {"stage": stage, "allowed": allowed, "unit": unit, "meaning": meaning, "place": place}
    return field(default=default, metadata=known)


def chosen(stage: str, default: Any, allowed: str, unit: str, meaning: str, reason: str) -> Any:
    """A field of `Choices`: as `stated`, with a reason instead of a place."""
    known = {"stage": stage, "allowed": allowed, "unit": unit, "meaning": meaning, "reason": reason}
    return field(default=default, metadata=known)


def check_field(f: "Field[Any]", value: Any) -> None:
    """Raise `ParameterError` unless a value is allowed for a field that `stated` or `chosen` made."""
    allowed, whole = f.metadata["allowed"], f.type is int
    if f.type is str:
        return check(value in allowed.split("|"), f.name, value, f"one of {allowed.replace('|', ', ')}")
    if f.type is bool:
        return check(isinstance(value, bool), f.name, value, "true or false")
    kind = f"a {'whole ' if whole else ''}number in {allowed}"
    check(is_number(value, whole), f.name, value, kind)
    if is_number(value, whole=True):
        check(abs(value) <= LARGEST_WHOLE, f.name, value, f"{kind}, at most {LARGEST_WHOLE}")
    low, high = (float(bound) for bound in allowed[1:-1].split(","))
    above = value >= low if allowed[0] == "[" else value > low
    below = value <= high if allowed[-1] == "]" else value < high
    check(math.isfinite(value) and above and below, f.name, value, kind)


def check_fields(values: Any) -> None:
    """Check every field of a `Paper` or `Choices`; numbers of other libraries become Python's own."""
    for f in fields(values):
        value = getattr(values, f.name)
        check_field(f, value)
        if is_number(value) and not isinstance(value, (int, float)):
            object.__setattr__(values, f.name, (int if f.type is int else float)(value))


def check_whole(name: str, value: Any, least: int, most: int = LARGEST_WHOLE) -> None:
    """Raise `ParameterError` unless a value is a whole number between two others."""
    ok = isinstance(value, int) and not isinstance(value, bool) and least <= value <= most
    check(ok, name, value, f"a whole number in [{least}, {most}]")
