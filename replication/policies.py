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
REGION = "region"  # how the name of a file with a region begins


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
    def order(self) -> tuple[bool, float, float]:
        """By α, without a supervisor last, then by Δ."""
        of = self.run.condition
        return of.alpha is None, of.alpha or 0.0, of.delta

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
        return f"{REGION}__alpha_{alpha_text(self.made_of.alpha)}__data_{self.made_of.seed}"

    @property
    def card(self) -> str:
        """Name of its card."""
        return f"{self.name}.md"

    @property
    def psi(self) -> str:
        """Its Ψ: the layers of a network, or how many neighbours."""
        a = self.region.arrays_
        if self.region.psi != "network":
            return f"{a.neighbours} nearest neighbours"
        sizes = [*a.network.first.shape, *a.network.last.shape]
        return f"network {' → '.join(map(str, sizes))}"


Stored = Policy | Region


def stored(path: Path) -> Stored:
    """A policy or a region, by its file's name; `ResultError`: it is neither, or damaged."""
    found: Stored = Region(path) if path.stem.startswith(REGION) else Policy(path)
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


def cards(folder: Path) -> dict[str, list[Path]]:
    """{name of a card: the files that it tells of}, by their names, in a folder; empty without any."""
    found: dict[str, list[Path]] = {}
    for path in sorted(folder.glob("*.npz")):
        name = path.stem if path.stem.startswith(REGION) else path.stem.rpartition("__")[0]
        found.setdefault(f"{name}.md", []).append(path)
    return found


def read(path: Path) -> Stored:
    """What is `stored` in a file; `ResultError`: it holds something else than its name says."""
    item = stored(path)
    if item.name != path.stem:
        raise ResultError(f"{path} holds {item.name}")
    return item


def varied(values: dict[str, Any]) -> str:
    """The values that are not the defaults, as NAME=VALUE."""
    usual = Config().as_dict()
    return " ".join(f"{name}={value}" for name, value in values.items() if value != usual[name])


def facts(folder: Path, card: str) -> tuple[str, dict[str, Any]]:
    """The template of a card, and what it takes.

    Raises:
        ResultError: a file is damaged or holds something else than its name says, or the seeds of a card were
            trained with different values or steps.
    """
    paths = cards(folder)
    if card == INDEX:
        items = [read(path) for found in paths.values() for path in found]
        of = {
            card: [item for item in items if isinstance(item, Policy) and item.card == card] for card in paths
        }
        groups = sorted(filter(None, of.values()), key=lambda group: group[0].order)
        told: dict[str, Any] = {"groups": groups}
        told |= {"regions": [item for item in items if isinstance(item, Region)]}
        size = sum(item.path.stat().st_size for item in items)
        return "index", told | {"size": size, "best": perfect_return(Config())}
    items = [read(path) for path in paths[card]]
    first = items[0]
    if isinstance(first, Region):
        return "region", {"item": first, "digest": sha256(first.path), "varied": varied(first.made_of.values)}
    policies = [item for item in items if isinstance(item, Policy)]
    same = ("config", "steps_done")
    if any(item.arrays.record.get(n) != first.arrays.record.get(n) for item in policies for n in same):
        raise ResultError(f"{first.path.with_name(card)}: its seeds were not trained alike")
    regions = [Region(path) for path in folder.glob(f"{REGION}*.npz")]
    told = {"items": policies, "regions": {item.region.digest(): item for item in regions}}
    told |= {"digests": {item.name: sha256(item.path) for item in policies}}
    return "policy", told | {
        "varied": varied(first.run.config.as_dict()),
        "best": perfect_return(first.run.config),
    }
