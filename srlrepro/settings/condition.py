"""A condition of the paper's experiment: α (or no supervisor) × Δ × seed, and how it is written."""

import math
from dataclasses import dataclass
from typing import Any

from srlrepro.settings.fields import ParameterError, check, check_whole, is_number, one_line

NONE = "none"  # the text of α where there is no supervisor
MOST_SEED = 2**32 - 1  # that numpy's global generator and scikit-learn take


def alpha_text(alpha: float | None) -> str:
    """The text of α in names, tables and legends: "0", "0.5", …, or "none" for no supervisor."""
    return NONE if alpha is None else f"{alpha:g}"


def parse_alpha(text: str, name: str = "alpha") -> float | None:
    """α of its text, None for "none"; else `ParameterError`, where ``name`` names it."""
    if text == NONE:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    check(0 <= value <= 1, name, text, "a number in [0, 1], or none")
    return abs(value)  # -0 is 0


def check_share(alpha: Any) -> None:
    """Raise `ParameterError` unless α is a share of UD."""
    check(is_number(alpha) and 0 <= alpha <= 1, "alpha", alpha, "a number in [0, 1]")


def check_delta(delta: Any) -> None:
    """Raise `ParameterError` unless Δ is a mass mismatch."""
    check(is_number(delta) and 0 < delta < math.inf, "delta", delta, "a finite number > 0")


@dataclass(frozen=True)
class Condition:
    """One cell of the grid; values that are not allowed raise `ParameterError`."""

    alpha: float | None  # share of UD in the training data of the region; None: no supervisor
    delta: float  # mass mismatch Δ > 0 of the real system
    seed: int  # of the learner

    def __post_init__(self) -> None:
        if self.alpha is not None:
            check_share(self.alpha)
        check_delta(self.delta)
        check_whole("seed", self.seed, 0, MOST_SEED)

    @property
    def alpha_text(self) -> str:
        """The text of α."""
        return alpha_text(self.alpha)

    @property
    def name(self) -> str:
        """Names the folder and the files of the condition."""
        return f"alpha_{self.alpha_text}__delta_{self.delta:g}__seed_{self.seed}"

    @classmethod
    def parse(cls, name: str) -> "Condition":
        """The condition of a `name`; `ParameterError` if it is no such name."""
        parts = [part.partition("_") for part in name.split("__")]
        known = [key for key, _, _ in parts] == ["alpha", "delta", "seed"]
        check(known, "condition", name, "such as alpha_0.5__delta_1.1__seed_0")
        try:
            found = Condition(parse_alpha(parts[0][2]), float(parts[1][2]), int(parts[2][2]))
        except ValueError as error:
            raise ParameterError(f"condition = {one_line(name)}: {error}") from error
        check(found.name == name, "condition", name, f"written in the shortest way, {found.name}")
        return found
