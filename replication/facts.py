"""What the documents tell: the claims with their verdicts and the findings of each study, from tables."""

import tomllib
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from replication.digests import SET, read_set
from replication.evidence.claims import LAYERS, MEASURE_COLUMNS, RATES, VERDICTS, load_claims
from replication.evidence.measures import TEST_STATES, read_measures
from replication.evidence.predictions import FAILS, HOLDS, OPEN
from replication.evidence.statistics import LEVEL
from replication.evidence.verdicts import (
    AS_WRITTEN,
    CALIBRATED,
    CONTRASTS,
    LONG,
    POLICIES,
    SELDOM,
    SIGNS,
    THREE,
    failures,
    is_there,
    judged_arm,
    matrix,
    resting,
    rows,
)
from replication.studies import caution, crossed, multiverse, shift
from replication.studies.designs import THRESHOLDS
from replication.studies.discrepancy import KINDS
from replication.studies.joints import training
from replication.studies.joints.answer import takeaway
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
    "data": ("near_origin_share", "safe_share", "corner_share", "embedding_purity", "accepted_share"),
    "generalisation": ("common_error", "common_false_positives"),
    "learning": POLICIES,
}
DRAWS = ("dataset", "learner")  # the choices of the multiverse that are none (multiverse.toml)
EXPLORER = "docs/explorer.html"
NEAREST = 3  # universes shown of those that come nearest to the paper's rates
BOUNDS = ("(15) for h, l", "(15) for h, l_n", "(11) minimum")  # what a class may break


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
        sets = sorted(self.figures.glob(f"*/{SET}"))
        return [path.parent.name for path in sets if read_set(path).get("arithmetic", 0) != ARITHMETIC]

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
        """{id: row of `verdicts.rows`} of the claims, with their ``section`` of the report."""
        places = {measure: section for section, measures in SECTIONS.items() for measure in measures}
        return {
            row["id"]: row | {"section": places.get(row["measure"], "safety")} for row in rows(self.figures)
        }

    @property
    def layers(self) -> dict[str, str]:
        """{layer: what its claims are}."""
        return LAYERS

    @property
    def signs_of_verdicts(self) -> dict[str, str]:
        """{verdict, or practically nothing: its sign}."""
        return SIGNS

    def layer(self, name: str) -> list[Row]:
        """The claims of a layer; what is said of the paper counts those of layer a."""
        return [row for row in self.claims.values() if row["layer"] == name]

    @property
    def seeds(self) -> int:
        """Seeds, each with a dataset, per condition behind the verdicts."""
        return max(int(row["n"]) for row in self.claims.values())

    def count(self, verdict: str, layer: str = "a", column: str = "verdict") -> int:
        """How many claims of a layer have a verdict; column: ``verdict_of_three`` for three seeds alone."""
        return sum(row[column] == verdict for row in self.layer(layer))

    def counts(self, layer: str = "a", column: str = "verdict") -> str:
        """How many claims of a layer have each verdict, in words; column: as of `count`."""
        found = {verdict: self.count(verdict, layer, column) for verdict in VERDICTS}
        return ", ".join(f"{n} {name}" for name, n in found.items() if n)

    def all(self, verdict: str, *claims: str) -> bool:
        """Whether all these claims have this verdict; a sentence that says so is else left out."""
        return all(self.claims[claim]["verdict"] == verdict for claim in claims)

    @cached_property
    def signs(self) -> list[Row]:
        """The rows of `verdicts.matrix`: layer, row (in words), a sign for each Δ, and overall."""
        contrasts = read_table(self.figures / self.grid / "contrasts.csv", CONTRASTS)
        return matrix(load_claims(), contrasts).to_dict("records")

    def sign(self, claim: str, column: str) -> str:
        """The sign of a claim at a Δ, as a text, or overall."""
        return next(str(row[column]) for row in self.signs if row["row"] == self.claims[claim]["row"])

    @cached_property
    def failures(self) -> dict[str, dict[str, dict[str, Row]]]:
        """{arm: {Δ, as a text: {α: how often K fails, as of `verdicts.failures`}}}; arms that were run."""
        arms = {AS_WRITTEN: self.grid} | ({CALIBRATED: CALIBRATED} if self.is_there(CALIBRATED) else {})
        found: dict[str, dict[str, dict[str, Row]]] = {}
        for arm, folder in arms.items():
            table = failures(read_measures(self.figures / folder / "measures.csv"))
            cells = found.setdefault(arm, {})
            for row in table.to_dict("records"):
                cells.setdefault(f"{row['delta']:g}", {})[str(row["alpha"])] = row
        return found

    def calibrated(self) -> Row:
        """The claims of layer a in the arm with calibrated evidence: counts in words, and which differ."""
        verdicts = judged_arm(self.figures, CALIBRATED)[0].set_index("id")["verdict"].to_dict()
        asked = [row | {"other": verdicts[row["id"]]} for row in self.layer("a")]
        asked = [row for row in asked if row["other"] != "not measured"]
        counts = pd.Series([row["other"] for row in asked]).value_counts()
        words = ", ".join(f"{counts[verdict]} {verdict}" for verdict in VERDICTS if verdict in counts)
        return {"counts": words, "differ": [row for row in asked if row["other"] != row["verdict"]]}

    def by_step(self) -> Row:
        """Of the paper's claims about what is learned: how many signs are the same from half the steps on.

        ``of`` so many, ``half``: the step. Empty if the trainings were not judged by their steps.
        """
        place = self.figures / self.grid / "verdict_by_step.csv"
        if not place.exists():
            return {}
        table = read_table(place, ("step", "row", "delta", "sign"), ("step",))
        half = table.loc[table["step"] >= table["step"].max() / 2, "step"].min()
        later = table[table["step"] >= half].groupby(["row", "delta"], dropna=False)["sign"].nunique()
        return {"half": int(half), "of": len(later), "same": int((later == 1).sum())}

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

    @property
    def origins(self) -> Row:
        """Regions learned from UD alone, without the origin as a state: how many, and how many deny it."""
        rows = self.table(THREE, "choices_origin.csv")
        gamma = [row["Γ(origin)"] for row in rows if not row["known origin"]]
        return {"of": len(gamma), "denied": sum(value <= Paper.p_t for value in gamma)}

    def explored(self) -> Row:
        """Which measures of discrepancy rise with Δ, and at each Δ the α with most reward that keeps p_t."""
        folder = self.figures / self.grid
        by_delta = (
            read_table(folder / "discrepancy.csv", ("delta", *KINDS)).groupby("delta")[list(KINDS)].mean()
        )
        outcomes = self.table(self.grid, "discrepancy_outcomes.csv")
        kept = [row for row in outcomes if (row["success_rate"] or 0) >= Paper.p_t]
        most = {row["delta"]: row["alpha"] for row in sorted(kept, key=lambda row: row["final_return"])}
        chosen = {row["delta"]: most.get(row["delta"]) for row in outcomes}
        return {"rise": [kind for kind in KINDS if by_delta[kind].is_monotonic_increasing], "alpha": chosen}

    def crossed(self) -> Row:
        """The dataset's share of the variance of each measure by α, its Δ, and how predictions came out."""
        columns = ("measure", "alpha", "datasets", "learners", "share", "low", "high")
        found = read_table(self.figures / "crossed" / "crossed_components.csv", columns, text=("alpha",))
        by = {name: found[found["measure"] == name] for name in crossed.JUDGED}
        deltas = read_table(self.figures / "crossed" / "measures.csv", ("delta",))["delta"].dropna().unique()
        return {
            "delta": " and ".join(f"{delta:g}" for delta in sorted(deltas)),
            "alphas": list(found["alpha"].unique()),
            "shares": {
                " ".join(crossed.JUDGED[name].split()): own.to_dict("records") for name, own in by.items()
            },
            "ends": {name: (own["share"].min(), own["share"].max()) for name, own in by.items()},
            "predicted": crossed.predicted(found),
        } | {name: int(found[name].max()) for name in ("datasets", "learners")}

    def caution(self) -> Row:
        """What α and all dimensions do at equal recall and at equal caution, and how predictions came out."""
        folder, ends = self.figures / "caution", (min(THRESHOLDS), max(THRESHOLDS))
        columns = ("hypothesis", "alpha", "delta", "dataset", "recall", "false_positives")
        equal = read_table(folder / "caution_recall.csv", columns, text=("alpha",))
        columns = ("delta", "outcome", "effect", "estimate", "low", "high")
        found = read_table(folder / "caution_effects.csv", columns, text=("effect", "state"))
        violations = found[(found["outcome"] == "log_violations") & (found["effect"] != caution.SLOPE)]
        is_svm = violations["effect"] == caution.SVM
        groups = {"svm": violations[is_svm], "alpha": violations[~is_svm]}
        runs = read_table(folder / "caution_frontier.csv", ("hypothesis", "p_t", "delta", "log_violations"))
        runs = runs[runs["hypothesis"] == Choices.hypothesis]
        medians = runs.pivot_table("log_violations", "delta", "p_t", aggfunc="median")[[*ends]]
        counts = np.exp(medians.to_numpy()) - caution.LEAST
        recall = max(caution.RECALLS)
        kept = equal[equal["recall"] == recall]
        rates = kept.pivot_table("false_positives", ["delta", "hypothesis"], "alpha", sort=False)
        return {
            "recall": recall,
            "alphas": list(rates),
            "rates": [(place, row.tolist()) for place, row in rates.iterrows()],
            "thresholds": ends,
            "violations": [(delta, *row) for delta, row in zip(medians.index, counts, strict=True)],
            "counts": {
                name: {"of": len(own)} | {s: int((own["state"] == s).sum()) for s in caution.STATES}
                for name, own in groups.items()
            },
            "predicted": caution.predicted(equal, found),
        }

    def shift(self) -> Row:
        """What training data nearer to the learner's states change, and how predictions came out."""
        names = ("measure", "delta", "variant", "mean", "written", "difference", "low", "high")
        found = read_table(self.figures / "shift" / "shift_contrasts.csv", names)
        rows = found[found["measure"].isin(shift.SHOWN)].to_dict("records")
        texts = {
            name: " ".join(text.replace("\\mathcal{D}", "D").replace("$", "").split())
            for name, text in shift.SHOWN.items()
        }
        sure: Row = {}
        for row in rows:
            row["difference"] = round(row["difference"], shift.DECIMALS) + 0.0
            if row["low"] > 0 or row["high"] < 0:
                sure.setdefault(texts[row["measure"]], []).append(row)
        lower = [row["measure"] for row in rows if row["high"] < 0]
        higher = [row["measure"] for row in rows if row["low"] > 0]
        return {
            "differences": len(rows),
            "by_chance": (1 - LEVEL) * len(rows),
            "sure": sure,
            "of": len({(row["delta"], row["variant"]) for row in rows}),
            "nearer": lower.count("distance"),
            "farther": higher.count("distance"),
            "fewer": lower.count("violations_per_1000_steps"),
            "agree": shift.agreement(found),
            "predicted": shift.predicted(found),
        }

    def joints(self) -> Row:
        """Where a low dimension pays where there are more joints, in sentences; how predictions came out."""
        found = read_table(self.figures / "joints" / "joints.csv", ("pair", "links", "k", "low", "high"))
        told = {"short": takeaway(found), "written": takeaway(found, "as written")}
        return self._counted("joints_predictions") | told

    def trained_joints(self) -> Row:
        """What learners of more joints say, in sentences; how predictions came out. Empty without them."""
        file = self.figures / "joints" / "joints_contrasts.csv"
        if not file.exists():
            return {}
        found = read_table(file, ("contrast", "outcome", "links", "delta", "sign"))
        return self._counted("joints_trained_predictions") | {
            "held": training.held(found),
            "chance": training.beside_chance(found),
        }

    def _counted(self, predictions: str) -> Row:
        states = read_table(self.figures / "joints" / f"{predictions}.csv", ("state",))["state"]
        return {name: int((states == name).sum()) for name in (HOLDS, FAILS, OPEN)}

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
                {"class": name, "of": len(part)}
                | {"vacuous": int((part["bound"] >= 1).sum())}
                | {"fails": [int((part[bound] < 0).sum()) for bound in BOUNDS]}
                for name, part in single.groupby("class", sort=False)
            ],
            "orders": len(wide),
            "same_order": int((wide["bound"] == wide["error"]).sum()),
            "mnd_first": int(wide["bound"].str.startswith("0 <").sum()),
        }

    def multiverse(self) -> Row:
        """In what share of the universes claims of layer a hold, what moves them, how near the rates come.

        Claims about learned policies are left out: the trainings of a universe are too short for them; so are
        those whose test the universes were not asked about, and rates of such tests.
        """
        folder = self.figures / "multiverse"
        names = ("claim", "design", "held", "universes", "violated", "unmeasured", "share", "low", "high")
        shares = read_table(folder / "shares.csv", names)
        shares["decided"] = shares["universes"] - shares["violated"] - shares["unmeasured"]
        drawn = shares[shares["design"] == multiverse.RANDOM].set_index("claim").to_dict("index")
        tested = [row | drawn[row["id"]] for row in self.layer("a") if row["id"] in drawn]
        tested = [row for row in tested if row["section"] != "learning" and row["decided"]]
        effects = read_table(folder / "main_effects.csv", ("claim", "choice", "effect", "q"))
        moving = effects[(effects["q"] < multiverse.LEVEL) & effects["claim"].isin(self.claims)]
        moving = moving.sort_values("effect", ascending=False)
        flips = read_table(folder / "flips.csv", ("claim", "choice"))
        usual = {choice.id: choice.levels[0].level for choice in multiverse.load_choices()}
        rates = read_table(folder / "papers_rates.csv", ("id", "margin"), text=tuple(usual))
        rates = rates if set(RATES) <= set(rates) else rates[:0]
        usual = {choice: level for choice, level in usual.items() if choice in rates}  # those of this run
        rates["differ"] = (rates[list(usual)] != pd.Series(usual)).sum(axis=1)
        sizes = shares.groupby("design")[["universes", "violated"]].max().sum()
        return {
            "tested": len(tested),
            "often": [row for row in tested if row["share"] >= 1 - SELDOM],
            "between": [row for row in tested if SELDOM < row["share"] < 1 - SELDOM],
            "seldom": [row for row in tested if row["share"] <= SELDOM],
            "steps": read_set(folder / SET)["steps"],
            "choices": len(usual) - len(DRAWS),
            "moved": moving.groupby("claim")["choice"].agg(list).to_dict(),
            "chance": flips.loc[flips["choice"].isin(DRAWS), "claim"].nunique(),
            "hits": int((rates["margin"] >= 0).sum()),
            "rated": len(rates),
            "nearest": rates.head(NEAREST).to_dict("records"),
        } | sizes.to_dict()
