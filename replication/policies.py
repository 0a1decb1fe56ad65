"""Final policies and regions to take home: copies of those of the grid, each with its card.

The copies are the files that the trainings wrote, byte for byte. A card tells what a file holds, from the
file alone, so that it cannot tell of another one.
"""

import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from replication.evidence.results import TrainedRun, as_run
from srlrepro.dynamics.circle_env import perfect_return
from srlrepro.learner.policy import TrainedPolicy, load_policy
from srlrepro.region.safe_region import SafeRegion
from srlrepro.settings.condition import alpha_text
from srlrepro.settings.config import Config
from srlrepro.storage.files import ResultError, beside, sha256
from srlrepro.storage.made_of import MadeOf

INDEX = "README.md"  # the card of the folder


@dataclass(frozen=True)
class Policy:
    """A stored policy, as its card tells of it."""

    path: Path

    @cached_property
    def arrays(self) -> TrainedPolicy:
        """What the file holds."""
        return load_policy(self.path)

    @cached_property
    def run(self) -> TrainedRun:
        """Its training; `ResultError`: the file tells of none."""
        return as_run(dict(self.arrays.record), self.path)

    @property
    def name(self) -> str:
        """The file's name without its suffix: that of the condition."""
        return self.run.condition.name

    @property
    def card(self) -> str:
        """Name of its card, which the seeds of a condition share."""
        return f"{self.name.rpartition('__')[0]}.md"

    @property
    def numbers(self) -> int:
        """How many weights, biases and log σ it has."""
        return sum(part.size for part in (*self.arrays.weights, *self.arrays.biases, self.arrays.log_std))


@dataclass(frozen=True)
class Region:
    """A stored region, as its card tells of it."""

    path: Path

    @cached_property
    def region(self) -> SafeRegion:
        """What the file holds."""
        return SafeRegion.load(self.path)

    @property
    def made_of(self) -> MadeOf:
        """What it was learned from; `ResultError`: the file does not say."""
        if self.region.made_of_ is None:
            raise ResultError(f"{self.path} does not say what it was made of")
        return self.region.made_of_

    @property
    def name(self) -> str:
        """The file's name without its suffix."""
        return f"region__alpha_{alpha_text(self.made_of.alpha)}__data_{self.made_of.seed}"

    @property
    def card(self) -> str:
        """Name of its card."""
        return f"{self.name}.md"


Stored = Policy | Region


def stored(path: Path) -> Stored:
    """A policy or a region, by its file's name; `ResultError`: it is neither, or damaged."""
    found: Stored = Region(path) if path.stem.startswith("region") else Policy(path)
    _ = found.name
    return found


def take(paths: Iterable[Path], folder: Path) -> list[str]:
    """Copy policies and regions of a grid into a folder, each under the name of what it holds.

    Raises:
        ResultError: one is missing, damaged, or does not say what it is.
    """
    found = [stored(path) for path in paths]
    for item in found:
        with beside(folder / f"{item.name}.npz") as temporary:
            shutil.copyfile(item.path, temporary)
    return [item.name for item in found]


def shelf(folder: Path) -> dict[str, list[Stored]]:
    """{name of a card: what it tells of} for all files of a folder; empty without any.

    Raises:
        ResultError: a file is damaged, or holds something else than its name says.
    """
    cards: dict[str, list[Stored]] = {}
    for path in sorted(folder.glob("*.npz")):
        item = stored(path)
        if item.name != path.stem:
            raise ResultError(f"{path} holds {item.name}")
        cards.setdefault(item.card, []).append(item)
    return cards


def varied(values: dict[str, Any]) -> str:
    """The values that are not the defaults, as NAME=VALUE."""
    usual = Config().as_dict()
    return " ".join(f"{name}={value}" for name, value in values.items() if value != usual[name])


def facts(folder: Path, card: str) -> tuple[str, dict[str, Any]]:
    """The template of a card, and what it takes.

    Raises:
        ResultError: as `shelf`, or the seeds of a card were trained with different values or code.
    """
    cards = shelf(folder)
    if card == INDEX:
        items = [item for found in cards.values() for item in found]
        policies = [item for item in items if isinstance(item, Policy)]
        regions = [item for item in items if isinstance(item, Region)]
        size = sum(item.path.stat().st_size for item in items)
        return "index", {
            "policies": policies,
            "regions": regions,
            "size": size,
            "best": perfect_return(Config()),
        }
    found = cards[card]
    first = found[0]
    if isinstance(first, Region):
        return "region", {"item": first, "digest": sha256(first.path), "varied": varied(first.made_of.values)}
    policies = [item for item in found if isinstance(item, Policy)]
    same = ("config", "code", "steps_done")
    if any(item.arrays.record.get(n) != first.arrays.record.get(n) for item in policies for n in same):
        raise ResultError(f"{first.path.with_name(card)}: its seeds were not trained alike")
    config = first.run.config
    regions = [item for items in cards.values() for item in items if isinstance(item, Region)]
    told = {"items": policies, "regions": {item.region.digest(): item for item in regions}}
    told |= {"digests": {item.name: sha256(item.path) for item in policies}}
    return "policy", told | {"varied": varied(config.as_dict()), "best": perfect_return(config)}
