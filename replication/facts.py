"""What the documents tell: the claims with their verdicts and the findings of each study, from tables."""

import tomllib
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from replication.evidence.claims import MEASURE_COLUMNS, RATES, load_claims
from replication.evidence.measures import TEST_STATES
from replication.evidence.verdicts import LONG, THREE, is_there, resting, rows
from replication.studies import multiverse
from replication.studies.alternatives import ORACLES
from replication.studies.theorem import POOLED, SMALLEST
from srlrepro.dynamics.circle_env import perfect_return
from srlrepro.pins import ARITHMETIC, KERNELS, THREADS
from srlrepro.settings.choices import Choices
from srlrepro.settings.config import Config
from srlrepro.settings.fields import STAGES
from srlrepro.settings.paper import Paper
from srlrepro.storage.files import LARGEST, read_json, read_table

Row = dict[Any, Any]
SECTIONS = {  # of the report: the measures whose claims stand there; those of all others are about safety
    "data": ("near_origin_share", "safe_share", "corner_share", "new_state_purity", "accepted_share"),
    "generalisation": ("common_error", "common_false_positives"),
    "learning": ("policy_return_share", "policy_alone_share", "training_left"),
}
HOLDS, FAILS, BOTH, OPEN = "✓", "✗", "±", "○"  # signs of a claim at one Δ
FIRST_TESTS = 20  # of claims.toml: fixed before any full training
DRAWS = ("dataset", "learner")  # the choices of the multiverse that are none (multiverse.toml)
EXPLORER = "docs/explorer.html"
NEAREST = 3  # universes shown of those that come nearest to the paper's rates
HALVED = 0.5
SELDOM = 0.25  # share of the random universes up to which a claim holds seldom; often is 1 less this
BOUNDS = ("(15) for h, l", "(15) for h, l_n", "(11) minimum")  # what a class may break


def sign(states: pd.Series) -> str:
    """The sign of the contrasts of a claim at one Δ, by the rule of the verdicts."""
    if (states == "supports").all():
        return HOLDS
    if (states == "contradicts").any():
        return BOTH if (states == "supports").any() else FAILS
    return OPEN


def text_of(value: object) -> str:
    """A parameter's value as it is written in the ledger."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.6g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True)
class Facts:
    """What is told of the results in a folder."""

    root: Path  # of the repository
    figures: Path  # the folder with the tables of results

    @property
    def records(self) -> Path:
        """The folder of times and of what else only an explicit command updates."""
        return self.root / "docs" / "records"

    @property
    def constants(self) -> Row:
        """Numbers of the package that the documents name."""
        found = {"stated": len(fields(Paper)), "chosen": len(fields(Choices)), "fresh_states": TEST_STATES}
        return found | {"k": Paper.k, "p_t": Paper.p_t, "largest": LARGEST // 2**20, "stages": STAGES}

    @property
    def pins(self) -> dict[str, str]:
        """{variable: value} of what is pinned."""
        return KERNELS | THREADS

    @property
    def arithmetic(self) -> int:
        """The number of the arithmetic that results made now rest on."""
        return ARITHMETIC

    @property
    def earlier(self) -> list[str]:
        """The sets of results that rest on another arithmetic, made before or beside the present one."""
        sets = sorted(self.figures.glob("*/workflow.json"))
        return [path.parent.name for path in sets if read_json(path).get("arithmetic", 0) != ARITHMETIC]

    def table(self, *place: str) -> list[Row]:
        """The rows of a table of results, or of the records by its name alone; None where a cell is empty."""
        folder = self.figures if place[1:] else self.records
        table = read_table(folder.joinpath(*place), ())
        return table.astype(object).where(table.notna(), None).to_dict("records")

    def time(self, name: str) -> Row:
        """Minutes, core hours and more that results of this name took; empty if they are not there."""
        file = self.records / f"{name}.json"
        told = file.exists() and (name not in LONG or self.is_there(name))
        found: Row = read_json(file) if told else {}
        return found

    def is_there(self, name: str) -> bool:
        """Whether a run beyond the paper's grid has left its results."""
        return is_there(self.figures, name)

    @cached_property
    def judged(self) -> Row:
        """What the grid took, how many conditions it has, a perfect trial's return, and what was not run."""
        cells = read_table(self.figures / THREE / "measures.csv", MEASURE_COLUMNS)
        conditions = cells.dropna(subset=["alpha", "delta"])[["alpha", "delta"]].drop_duplicates()
        found = {"run": read_json(self.records / f"{THREE}.json"), "conditions": len(conditions)}
        missing = [text for name, (_, text) in LONG.items() if not self.is_there(name)]
        return found | {"best": perfect_return(Config()), "missing": missing}

    @property
    def grid(self) -> str:
        """The name of the results that the verdicts rest on."""
        return resting(self.figures)

    @cached_property
    def claims(self) -> dict[str, Row]:
        """{id: row of `verdicts.rows`} of the claims, with ``section``, and ``three``, the first verdict."""
        places = {measure: section for section, measures in SECTIONS.items() for measure in measures}
        sections = {claim.id: places.get(claim.measure, "safety") for claim in load_claims()}
        told = {row["id"]: row for row in rows(self.figures)}
        for name, row in told.items():
            row |= {"section": sections[name], "three": row.get("verdict_of_three", row["verdict"])}
            row["verdict"] = row["verdict"] if row["n"] else "not measured"
        return told

    @property
    def posed(self) -> list[Row]:
        """The claims whose test can decide them."""
        return [row for row in self.claims.values() if not row["ill_posed"]]

    @property
    def seeds(self) -> int:
        """Seeds per condition behind the verdicts."""
        return max(int(row["n"]) for row in self.posed)

    def count(self, verdict: str, column: str = "verdict") -> int:
        """How many of the well-posed claims have a verdict."""
        return sum(row[column] == verdict for row in self.posed)

    def late(self) -> int:
        """How many of the well-posed tests were written when three seeds had been seen."""
        first = {claim.id for claim in load_claims()[:FIRST_TESTS]}
        return sum(row["id"] not in first for row in self.posed)

    def all(self, verdict: str, *claims: str) -> bool:
        """Whether all these claims have this verdict; a sentence that says so is else left out."""
        return all(self.claims[claim]["verdict"] == verdict for claim in claims)

    @cached_property
    def by_delta(self) -> dict[str, dict[float, str]]:
        """{id: {Δ: sign}} of the well-posed claims that are tested at each Δ by itself."""
        contrasts = read_table(self.figures / self.grid / "contrasts.csv", ("id", "contrast", "state"))
        contrasts["delta"] = contrasts["contrast"].str.extract(r"^Δ = ([^:]+): ")[0].astype(float)
        signs = contrasts.dropna(subset="delta").groupby(["id", "delta"], sort=False)["state"].agg(sign)
        told = set(signs.index.get_level_values("id"))
        return {row["id"]: signs[row["id"]].to_dict() for row in self.posed if row["id"] in told}

    @cached_property
    def pictures(self) -> dict[str, Row]:
        """The figures of ``docs/figures.toml``, each with the places of its executed notebook."""
        table: dict[str, Row] = tomllib.loads((self.root / "docs/figures.toml").read_text(encoding="utf-8"))
        for entry in table.values():
            found = sorted((self.root / "notebooks/executed" / THREE).rglob(f"{entry['notebook']}.ipynb"))
            entry["executed"] = [path.relative_to(self.root).as_posix() for path in found]
        return table

    def gallery(self) -> list[Row]:
        """Every figure of ``docs/figures.toml`` that is there, in its order, of the set with most seeds.

        Paths are from the repository: ``pictures``, the ``table`` that is drawn, a ``pdf``, the ``executed``
        notebook, and ``elsewhere`` the picture of the paper's grid, if the first one is of more seeds. Where
        there is no such file, it is empty. ``command`` makes the figure.
        """
        found = []
        for name, entry in self.pictures.items():
            sets = [entry["study"]] if "study" in entry else [self.grid, THREE]
            places = {group: self._pictures(group, name) for group in sets}
            groups = [group for group in sets if places[group]]
            if not groups:
                continue
            group, options = groups[0], ["./reproduce.sh"]
            options += [f"--{entry['study']}"] if "study" in entry else []
            options += ["--seeds", group.removeprefix("seeds_")] if group.startswith("seeds_") else []
            executed = (self.root / "notebooks/executed" / group).rglob(f"{entry['notebook']}.ipynb")
            row = {"paper": "", "name": name} | entry | {"pictures": places[group]}
            row |= {"executed": next((self._from_root(path) for path in sorted(executed)), "")}
            beside = self.root / places[group][0]
            for key, suffix in (("table", ".csv"), ("pdf", ".pdf")):
                row[key] = self._from_root(path) if (path := beside.with_suffix(suffix)).exists() else ""
            row["elsewhere"] = places[THREE][0] if group != THREE and THREE in groups else ""
            found.append(row | {"command": " ".join([*options, "--only", name])})
        return found

    def _from_root(self, path: Path) -> str:
        return path.relative_to(self.root).as_posix()

    def _pictures(self, group: str, name: str) -> list[str]:
        """Paths of a figure's pictures in a set: itself, a folder, or several that go on from its name."""
        folder = self.figures / group
        itself = [path for form in ("png", "gif") if (path := folder / f"{name}.{form}").exists()]
        several = [p for p in sorted(folder.glob(f"{name}_*.png")) if p.stem not in self.pictures]
        return [self._from_root(p) for p in itself or sorted((folder / name).glob("*.gif")) or several]

    def has_page(self, name: str) -> bool:
        """Whether docs/ has a page of this name."""
        return (self.root / "docs" / f"{name}.md").exists()

    @property
    def has_policies(self) -> bool:
        """Whether there are policies to take home."""
        return any((self.root / "policies").glob("*.npz"))

    @property
    def explorer(self) -> str:
        """Path of the page on which a reader can move a state; empty if it has not been made."""
        return EXPLORER if (self.root / EXPLORER).exists() else ""

    def regions(self) -> list[Row]:
        """Per α: measures of the training data and the region that all runs use."""
        measures = read_table(self.figures / THREE / "measures.csv", MEASURE_COLUMNS)
        own = measures[measures["delta"].isna() & (measures["seed"] == 0)]
        wide = own.pivot_table(index="alpha", columns="measure", values="value")
        return wide.reset_index().to_dict("records")

    def ledger(self) -> dict[str, list[Row]]:
        """{stage: parameters}: name, value, unit, meaning, and why: the paper's place, or our reason."""
        stages: dict[str, list[Row]] = {stage: [] for stage in STAGES}
        for part, source in ((Paper, "place"), (Choices, "reason")):
            for f in fields(part):
                row = {"name": f.name, "value": text_of(f.default), "stated": part is Paper}
                row |= {"unit": f.metadata["unit"], "meaning": f.metadata["meaning"]}
                stages[f.metadata["stage"]].append(row | {"why": f.metadata[source]})
        return stages

    def computing(self) -> list[Row]:
        """The ledger of computing; rows that name results take what these say of their own time."""
        ledger = self.table("computing.csv")
        for row in ledger:
            time, less = (self.time(row[name]) if row[name] else {} for name in ("times", "beyond"))
            row |= {name: time[name] for name in ("steps", "minutes") if time}
            row |= {n: time[n] - less.get(n, 0) for n in ("trainings", "core_hours") if n in time}
            cores, row["ran"] = row["cores"], bool(time) or not row["times"]
            row["most"] = row["minutes"] * cores / 60 if cores else None  # all cores, all the time
        return ledger

    def rounding(self) -> pd.Series:
        """By how much another order of sums moved the mean final return of each condition."""
        table = read_table(self.records / "rounding.csv", ("measure", "before", "after"))
        returns = table[table["measure"] == "final_return"]
        return (returns["after"] - returns["before"]).abs()

    def theorem(self) -> Row:
        """Theorem 1 over all trainings: how loose it is, what its class needs, and how it ranks the α's."""
        folder = self.figures / self.grid
        names = ("visited_by", "seed", "class", "error", "bound", *BOUNDS)
        table = read_table(folder / "theorem_divergence.csv", names)
        single = table[table["seed"] != POOLED]
        smallest = single[(single["class"] == SMALLEST) & (single["visited_by"] == "supervised")]
        columns = ("class", "source_error", "half_divergence", "e1", "e2", "bound")
        terms = read_table(folder / "theorem_terms.csv", columns)
        terms = terms[terms["class"] == SMALLEST].assign(third=terms[["e1", "e2"]].min(axis=1))
        parts = terms[["source_error", "half_divergence", "third"]].mean() / terms["bound"].mean()
        orders = read_table(folder / "theorem_orders.csv", ("visited_by", "delta", "quantity", "order of α"))
        by = ["visited_by", "delta"]
        wide = orders.pivot_table("order of α", index=by, columns="quantity", aggfunc="first")
        return {
            "ratio": (smallest["bound"] / smallest["error"]).agg(["min", "median", "max"]),
            "shares": parts.to_dict(),
            "classes": [
                {"class": name, "of": len(part), "low": part["bound"].min(), "high": part["bound"].max()}
                | {"vacuous": int((part["bound"] >= 1).sum())}
                | {"fails": [int((part[bound] < 0).sum()) for bound in BOUNDS]}
                for name, part in single.groupby("class", sort=False)
            ],
            "orders": len(wide),
            "same_order": int((wide["bound"] == wide["error"]).sum()),
            "mnd_first": int(wide["bound"].str.startswith("0 <").sum()),
        }

    def multiverse(self) -> Row:
        """In what share of the universes claims hold, what moves them, and how near the paper's rates come.

        Claims about learned policies are left out: the trainings of a universe are too short for them.
        """
        folder = self.figures / "multiverse"
        names = ("claim", "design", "held", "universes", "violated", "unmeasured", "share", "low", "high")
        shares = read_table(folder / "shares.csv", names)
        shares["decided"] = shares["universes"] - shares["violated"] - shares["unmeasured"]
        drawn = shares[shares["design"] == multiverse.RANDOM].set_index("claim").to_dict("index")
        tested = [row | drawn[row["id"]] for row in self.posed if row["section"] != "learning"]
        tested = [row for row in tested if row["decided"]]
        effects = read_table(folder / "main_effects.csv", ("claim", "choice", "effect", "q"))
        moving = effects[(effects["q"] < multiverse.LEVEL) & effects["claim"].isin(self.claims)]
        moving = moving.sort_values("effect", ascending=False)
        flips = read_table(folder / "flips.csv", ("claim", "choice"))
        usual = {choice.id: choice.levels[0].level for choice in multiverse.load_choices()}
        rates = read_table(folder / "papers_rates.csv", ("id", *RATES, "margin"), text=tuple(usual))
        rates["differ"] = (rates[list(usual)] != pd.Series(usual)).sum(axis=1)
        sizes = shares.groupby("design")[["universes", "violated"]].max().sum()
        return {
            "tested": len(tested),
            "often": [row for row in tested if row["share"] >= 1 - SELDOM],
            "between": [row for row in tested if SELDOM < row["share"] < 1 - SELDOM],
            "seldom": [row for row in tested if row["share"] <= SELDOM],
            "steps": read_json(folder / "workflow.json")["steps"],
            "choices": len(usual) - len(DRAWS),
            "moved": moving.groupby("claim")["choice"].agg(list).to_dict(),
            "chance": flips.loc[flips["choice"].isin(DRAWS), "claim"].nunique(),
            "hits": int((rates["margin"] >= 0).sum()),
            "rated": len(rates),
            "nearest": rates.head(NEAREST).to_dict("records"),
        } | sizes.to_dict()

    def hypotheses(self) -> Row:
        """Brier scores as multiples of the paper's region, and which hypotheses cannot guard."""
        folder = self.figures / "hypotheses"
        names = ("hypothesis", "alpha", "states", "delta", "brier")
        scores = read_table(folder / "hypotheses_classification.csv", names, text=("alpha",))
        summary = read_table(folder / "hypotheses_summary.csv", ("hypothesis", "alpha"), text=("alpha",))
        cells = ["states", "delta", "alpha"]
        brier = scores.pivot_table(index=cells, columns="hypothesis", values="brier", sort=False)
        means = brier.groupby(level=["states", "delta"], sort=False).mean()
        perceptron = (brier["mlp"] / brier[Choices.hypothesis]).dropna()
        classified, trained = (t[["hypothesis", "alpha"]].drop_duplicates() for t in (scores, summary))
        never = classified.merge(trained, how="left", indicator=True).query("_merge == 'left_only'")
        return {
            "ratio": means.div(means[Choices.hypothesis], axis=0).reset_index().to_dict("records"),
            "columns": [name for name in means if name not in ORACLES],
            "cells": len(perceptron),
            "better": int((perceptron < 1).sum()),
            "halved": int((perceptron <= HALVED).sum()),
            "untrained": never.groupby("hypothesis", sort=False)["alpha"].agg(list).to_dict(),
            "oracles": summary[summary["hypothesis"].isin(ORACLES)].to_dict("records"),
        }
