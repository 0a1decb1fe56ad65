r"""Learners of pendulums with two to five joints: does what holds at n = 3 hold when the state grows?

In every dataset there are learners under the map as written and under `WHOLE_STATE`, learned from UD alone
(α = 1) and from the MND alone (α = 0), each with the p_t at which it accepts the share `RECALL` of the safe
states that a random policy visits; and a free learner. Differences are taken within a dataset and averaged
over what both sides have (α, or the kind of hypothesis). Datasets are the unit of all 95 % t-intervals.
"""

import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

from replication.evidence.measures import LABEL_EVERY
from replication.evidence.predictions import EXPECTED, judge
from replication.evidence.results import DATA, RECORD, REGION, TrainedRun, read_run
from replication.evidence.statistics import LEVEL, contrast_interval
from replication.studies.alternatives import learn_hypothesis
from replication.studies.caution import LEAST
from replication.studies.designs import WHOLE_STATE, tells
from replication.studies.joints.answer import listed
from replication.studies.joints.chains import learning
from replication.studies.joints.rungs import RUNGS, WHOLE
from srlrepro.dynamics.circle_env import perfect_return
from srlrepro.dynamics.pendulum import Floats
from srlrepro.region.hypothesis import CompiledHypothesis
from srlrepro.region.safe_region import SafeRegion
from srlrepro.samplers import TrainingData
from srlrepro.settings.choices import Choices
from srlrepro.settings.condition import NONE
from srlrepro.settings.fields import check
from srlrepro.settings.paper import Paper
from srlrepro.storage.files import ResultError

PREDICTIONS = Path(__file__).with_name("predictions_training.toml")
MAP = Choices.hypothesis
PLACE = ["links", "delta"]
CELL = ["links", "hypothesis", "alpha", "delta", "dataset"]
KNOWN = Paper.links  # of which the rest of the project tells
OUTCOMES = {  # of a learner, and what they are called
    "return_share": "final return, share of a perfect one",
    "failure_rate": "share of K's activations that fail",
    "log_violations": "ln of violations",
    "activated_share": "share of trials that K ends",
    "caution": "share of the free learner's states that h rejects",
}
OF_FREE = ("return_share", "log_violations")  # those that a learner without a supervisor has too
CONTRASTS = {  # each side by its values, and what both sides share besides the dataset
    "map − whole state": ({"hypothesis": MAP}, {"hypothesis": WHOLE_STATE}, ["alpha"]),
    "α = 1 − α = 0, map": ({"hypothesis": MAP, "alpha": "1"}, {"hypothesis": MAP, "alpha": "0"}, []),
    "α = 1 − α = 0, whole state": (
        {"hypothesis": WHOLE_STATE, "alpha": "1"},
        {"hypothesis": WHOLE_STATE, "alpha": "0"},
        [],
    ),
    "map − free learner": ({"hypothesis": MAP}, {"hypothesis": NONE}, []),
}
COLUMNS = ["contrast", "outcome", *PLACE, "datasets", "estimate", "low", "high"]


def learners(folders: Mapping[str, Path], measures: pd.DataFrame) -> pd.DataFrame:
    """A row for each learner: `CELL`, p_t, activations, and `OUTCOMES`.

    Args:
        folders: of the universes, by their ids. measures: theirs, gathered.

    Returns:
        Of a free learner the hypothesis is "none", and p_t, failure_rate and caution are NaN. So is a failure
        rate where K was never activated. Half a violation is added before the logarithm.

    Raises:
        ResultError: a product is missing or damaged, or not of the hypothesis that is learned here.
    """
    runs = measures[measures["delta"].notna()]
    table = runs.pivot_table(index=CELL, columns="measure", values="value")
    needed = ["final_return", "activations", "failures", "falls", "activated_share"]
    table = table.reindex(columns=needed).reset_index()
    best = {n: perfect_return(learning(n)) for n in table["links"].unique()}
    table["return_share"] = table["final_return"] / table["links"].map(best)
    table["failure_rate"] = table["failures"] / table["activations"].where(table["activations"] > 0)
    table["log_violations"] = np.log(table["failures"] + table["falls"] + LEAST)
    asked = pd.DataFrame(_cautions(folders), columns=[*CELL, "p_t", "caution"])
    table = table.merge(asked, how="left", on=CELL)
    table.loc[table["alpha"] == NONE, "hypothesis"] = NONE
    return table[[*CELL, "p_t", "activations", *OUTCOMES]].sort_values(CELL, ignore_index=True)


def _cautions(folders: Mapping[str, Path]) -> Iterator[tuple[int, str, str, float, int, float, float]]:
    """`CELL`, p_t and caution of every supervised learner whose universes have a free one."""
    runs = [
        (name, read_run(record))
        for name, f in folders.items()
        for record in sorted(f.glob(f"runs/*/{RECORD}"))
    ]
    free = {}
    for name, run in runs:
        if run.condition.alpha is None:
            every = max(1, LABEL_EVERY * len(x := run.visited()) // run.steps)  # as `labelled`
            free[tells(name)["links"], run.condition.delta, run.condition.seed] = x[::every]
    known: dict[tuple[str, str], CompiledHypothesis] = {}  # one for all mismatches
    for name, run in runs:
        told, of = tells(name), run.condition
        key = told["links"], of.delta, of.seed
        if of.alpha is None or key not in free:
            continue
        if (name, of.alpha_text) not in known:
            known[name, of.alpha_text] = _hypothesis(folders[name], run, int(told["dataset"]))
        if (h := known[name, of.alpha_text]).digest() != run.region:
            raise ResultError(f"{folders[name]} does not hold what supervised {run.folder}")
        caution = float(1 - h.predict(free[key]).mean())
        yield int(told["links"]), told["hypothesis"], of.alpha_text, of.delta, of.seed, h.p_t, caution


def _hypothesis(universe: Path, run: TrainedRun, dataset: int) -> CompiledHypothesis:
    """What supervised a run: from its file, or learned anew from the data with the p_t of the run."""
    folder = universe / f"alpha_{run.condition.alpha_text}"
    if run.config.choices.hypothesis == MAP:
        return SafeRegion.load(folder / REGION)
    return learn_hypothesis(TrainingData.load(folder / DATA), run.config, dataset)


def differences(runs: pd.DataFrame, contrast: str, outcome: str) -> pd.DataFrame:
    """A contrast within every n, Δ and dataset that has both sides: `PLACE`, dataset, value.

    runs: of `learners`.
    """
    first, second, shared = CONTRASTS[contrast]
    keys = [*PLACE, "dataset", *shared]
    sides = []
    for values in (first, second):
        own = runs[np.logical_and.reduce([runs[name] == value for name, value in values.items()])]
        sides.append(own.groupby(keys)[outcome].mean())
    value = (sides[0] - sides[1]).dropna()
    return value.groupby([*PLACE, "dataset"]).mean().rename("value").reset_index()


def contrasts(runs: pd.DataFrame) -> pd.DataFrame:
    """Every contrast of every outcome that both sides have, by n and Δ: `COLUMNS`, and ``sign``.

    runs: of `learners`. The sign is "more" or "less" where the interval leaves out 0, and else "open".
    """
    rows = []
    for contrast in CONTRASTS:
        for outcome in OUTCOMES if NONE not in CONTRASTS[contrast][1].values() else OF_FREE:
            for place, own in differences(runs, contrast, outcome).groupby(PLACE):
                found = contrast_interval([own["value"].to_numpy()], [1.0])
                rows.append((contrast, outcome, *place, len(own), *found))
    table = pd.DataFrame(rows, columns=COLUMNS)
    return table.assign(sign=np.where(table["low"] > 0, "more", np.where(table["high"] < 0, "less", "open")))


def sentences(found: pd.DataFrame) -> list[str]:
    """What is decided at which n, a sentence for each contrast and Δ; last, `held`. found: of `contrasts`."""
    said = []
    for (contrast, delta), own in found.groupby(["contrast", "delta"], sort=False):
        parts, undecided = [], []
        for outcome, rows in own.groupby("outcome", sort=False):
            words = OUTCOMES[str(outcome)]
            signs = {sign: rows.loc[rows["sign"] == sign, "links"] for sign in ("more", "less")}
            told = [f"{sign} at n = {listed(n)}" for sign, n in signs.items() if len(n)]
            if told:
                parts.append(f"{words}: {', '.join(told)}")
            else:
                undecided.append(words)
        parts += [f"open at every n: {', '.join(undecided)}"] if undecided else []
        said.append(f"Δ = {delta:g}, {contrast}: {'; '.join(parts)}.")
    return [*said, held(found)]


def held(found: pd.DataFrame) -> str:
    """Whether the sign of what is decided at n = `KNOWN` is that at every other n; found: of `contrasts`."""
    keys = ["contrast", "outcome", "delta"]
    at_three = found[(found["links"] == KNOWN) & (found["sign"] != "open")]
    beside = found[found["links"] != KNOWN].merge(at_three[[*keys, "sign"]], on=keys, suffixes=("", "_known"))
    decided = beside[beside["sign"] != "open"]
    same = int((decided["sign"] == decided["sign_known"]).sum())
    own = int((found["links"] == KNOWN).sum())
    return (
        f"Of the {own} contrasts at n = {KNOWN}, {len(at_three)} {'is' if len(at_three) == 1 else 'are'} "
        f"decided. With fewer or more joints the sign is the same in {same} of {len(beside)} cases, the "
        f"opposite in {len(decided) - same}, and open in {len(beside) - len(decided)}."
    )


def beside_chance(found: pd.DataFrame) -> str:
    """How many contrasts are decided, and would be by chance, with and without a free learner in them.

    found: of `contrasts`.
    """
    free = found["contrast"].map(lambda name: NONE in CONTRASTS[name][1].values())
    parts = []
    for place, rows in (("between supervised learners", found[~free]), ("against a free one", found[free])):
        decided, chance = int((rows["sign"] != "open").sum()), (1 - LEVEL) * len(rows)
        parts.append(
            f"{place} {decided} of {len(rows)} contrasts are decided, {chance:.2g} would be by chance"
        )
    return f"Over all n, {'; '.join(parts)}."


def best_of_whole(recall: pd.DataFrame, links: Iterable[int]) -> pd.DataFrame:
    """Which hypothesis of the whole state accepts fewest unsafe visits in the cells: links, best, and of all.

    recall: of `at_equal_recall`. Means over datasets and both ends of α at Δ = 1.1, of the largest k that is
    not above the paper's.
    """
    own = recall[
        (recall["law"] == "visits") & (recall["delta"] == 1.1) & (recall["alpha"].astype(float) != 0.5)
    ]
    own = own[own["links"].isin(list(links)) & (own["k"] <= Paper.k)]
    means = own[own["k"] == own["k"].max()].groupby("links")[[name for name in WHOLE if name in own]].mean()
    found: pd.DataFrame = means.assign(best=means.idxmin(axis=1)).reset_index()
    return found


def choice_sentence(best: pd.DataFrame) -> str:
    """Whether the hypothesis of the whole state that learners had is the best; best: of `best_of_whole`."""
    other = best[best["best"] != WHOLE_STATE]
    name = RUNGS[WHOLE_STATE].text
    if not len(best):
        return f"No cells tell whether a {name} is the best of the whole state."
    if not len(other):
        return f"Without training, a {name} is the best of the whole state at n = {listed(best['links'])}."
    pairs = zip(other["best"], other["links"], strict=True)
    told = ", ".join(f"{RUNGS[kind].text} at n = {n}" for kind, n in pairs)
    return f"Without training, another hypothesis of the whole state is better than a {name}: {told}."


@dataclass(frozen=True)
class Prediction:
    """An entry of predictions_training.toml, which says what each field is."""

    id: str
    statement: str
    contrast: str
    outcome: str
    delta: float
    links: tuple[int, ...]
    expected: str
    bound: float
    than: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        check(self.contrast in CONTRASTS, "contrast", self.contrast, f"one of {', '.join(CONTRASTS)}")
        check(self.outcome in OUTCOMES, "outcome", self.outcome, f"one of {', '.join(OUTCOMES)}")
        check(self.expected in EXPECTED, "expected", self.expected, f"one of {', '.join(EXPECTED)}")

    def values(self, runs: pd.DataFrame) -> Floats:
        """What is predicted, in each dataset that has all of it; runs: of `learners`."""
        own = differences(runs, self.contrast, self.outcome)
        wide = own[own["delta"] == self.delta].pivot_table("value", "dataset", "links")
        wide = wide.reindex(columns=[*self.links, *self.than])
        found = wide[list(self.links)].mean(axis=1, skipna=False)
        if self.than:
            found = found - wide[list(self.than)].mean(axis=1, skipna=False)
        return found.dropna().to_numpy()


@cache
def load_predictions() -> tuple[Prediction, ...]:
    """The predictions, in their order; `ParameterError`: one names no contrast or no outcome."""
    told = tomllib.loads(PREDICTIONS.read_text(encoding="utf-8"))
    return tuple(Prediction(**entry) for entry in told["prediction"])


def judged(runs: pd.DataFrame, predictions: Iterable[Prediction] | None = None) -> pd.DataFrame:
    """Every prediction with its estimate, interval and state, see `judge`; runs: of `learners`."""
    told = load_predictions() if predictions is None else predictions
    return judge((p, p.values(runs)) for p in told)
