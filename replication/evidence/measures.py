"""Every measure that a claim is tested on, once: of training data, of regions, and of trained runs.

Data and regions are measured on fresh states of the nominal system, runs on what they have written. Nothing
is trained here.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.random import Generator
from numpy.typing import ArrayLike
from scipy.spatial.distance import cdist
from sklearn.calibration import calibration_curve
from sklearn.metrics import brier_score_loss, confusion_matrix

from replication.evidence.claims import MEASURE_COLUMNS
from replication.evidence.results import TrainedRun, require_same
from srlrepro.dynamics.circle_env import perfect_return
from srlrepro.dynamics.closed_loop import ClosedLoop, Labels
from srlrepro.dynamics.pendulum import Floats
from srlrepro.region.hypothesis import CompiledHypothesis
from srlrepro.region.safe_region import SafeRegion
from srlrepro.region.tsne import label_purity
from srlrepro.samplers import MultivariateNormal, TrainingData, known_states, sample_mnd, sample_uniform
from srlrepro.settings.condition import Condition
from srlrepro.settings.config import Config
from srlrepro.settings.fields import check
from srlrepro.storage.files import read_table, write_table

TEST_STATES = 5000  # per distribution: the standard error of a share is at most 0.007
BINS = 10
LAST_SHARE = 10  # the end of a training is the last tenth of its steps
SATISFYING = 0.75  # of a perfect trial's return, as for "finds-satisfying-policy" in claims.toml
BUDGETS = 6  # parts of a training, at the end of each of which it is judged as if it had ended there
LABEL_EVERY = 25  # steps of a training between two labelled states, at least: nearer ones are much the same

Labelled = tuple[Floats, Labels]  # states x [N, 2n], rad and rad/s, and their labels [N]
Learned = Mapping[str, tuple[TrainingData, CompiledHypothesis]]  # by the text of α
Row = tuple[Any, ...]  # of a table of measures


def classification(region: CompiledHypothesis, x: Floats, labels: Labels) -> dict[str, float]:
    """Errors of any hypothesis h, and of its Γ = P(l(x) = 1), on the states x [B, 2n] with true labels [B].

    Returns:
        ``error``: E[I(h ≠ l)], eq. (9); ``false_positives``, ``false_negatives``: its two parts, eq. (12);
        ``accepted``: share with h = 1; ``safe``: share with l = 1; ``precision``: P(l = 1 | h = 1);
        ``recall``: P(h = 1 | l = 1); ``brier``: mean squared error of Γ. A ratio of nothing is NaN.
    """
    probability = region.safety(x)
    h = (probability > region.p_t).astype(np.int64)
    (_, fp), (fn, tp) = confusion_matrix(labels, h, labels=[0, 1]) / len(x)
    scores = {"error": fp + fn, "false_positives": fp, "false_negatives": fn}
    scores |= {"accepted": tp + fp, "safe": tp + fn}
    scores["precision"] = tp / (tp + fp) if tp + fp > 0 else float("nan")
    scores["recall"] = tp / (tp + fn) if tp + fn > 0 else float("nan")
    return scores | {"brier": float(brier_score_loss(labels, probability, pos_label=1))}


def reliability(region: CompiledHypothesis, x: Floats, labels: Labels) -> pd.DataFrame:
    """Observed share of safe states against the mean predicted Γ, in bins of equal width of Γ."""
    observed, predicted = calibration_curve(labels, region.safety(x), n_bins=BINS)
    return pd.DataFrame({"predicted": predicted, "observed": observed})


def held_out_states(mnd: MultivariateNormal, config: Config, rng: Generator) -> dict[str, Labelled]:
    """{"UD": (x, l_n(x)), "MND": …}: fresh states of both distributions, labelled on the nominal system."""
    nominal = ClosedLoop.from_config(config)
    states = {"UD": sample_uniform(TEST_STATES, config.paper.state_max, rng)}
    states["MND"] = sample_mnd(TEST_STATES, mnd, config, rng)
    return {name: (x, nominal.predict(x)) for name, x in states.items()}


def first_link_shares(x: ArrayLike, config: Config) -> dict[str, float]:
    """Shares of states in two parts of the plane (θ1, θ̇1) of Fig. 2 (a)-(c).

    ``near_origin_share``: both within half their ranges; ``corner_share``: both beyond, with opposite signs.
    """
    states, high, links = np.asarray(x), config.paper.state_max, config.paper.links
    angle, rate = states[:, 0] / high[0], states[:, links] / high[links]
    near = (np.abs(angle) < 0.5) & (np.abs(rate) < 0.5)
    corner = (np.abs(angle) > 0.5) & (np.abs(rate) > 0.5) & (angle * rate < 0)
    return {"near_origin_share": float(near.mean()), "corner_share": float(corner.mean())}


def measure_data(data: TrainingData, config: Config) -> dict[str, float]:
    """``safe_share`` of the training states, and their `first_link_shares`."""
    return {"safe_share": float(data.z.mean()), **first_link_shares(data.x, config)}


def measure_embedding(data: TrainingData, region: SafeRegion, config: Config) -> dict[str, float]:
    """Label purity among the training states: ``state_purity`` of the scaled states, ``embedding_purity``."""
    scaled = known_states(data, config)[0] / config.paper.state_max
    points = {"state_purity": scaled, "embedding_purity": region.embedding_}
    return {name: label_purity(cdist(p, p), region.labels_) for name, p in points.items()}


def new_state_purity(region: SafeRegion, states: Mapping[str, Labelled], n_ud: int, k: int) -> float:
    """Label purity among the places Ψ(x) of k states of `held_out_states`, n_ud of them from UD."""
    (ud, ud_labels), (mnd, mnd_labels) = states["UD"], states["MND"]
    y = region.transform(np.concatenate([ud[:n_ud], mnd[: k - n_ud]]))
    return label_purity(cdist(y, y), np.concatenate([ud_labels[:n_ud], mnd_labels[: k - n_ud]]))


def measure_hypothesis(
    data: TrainingData, region: CompiledHypothesis, states: Mapping[str, Labelled], config: Config
) -> dict[str, float]:
    """How good h and Γ, learned from the data, are on fresh states of `held_out_states`.

    ``precision_UD``, … and those of ``recall`` and ``brier``, for both distributions; ``accepted_share``, the
    mean over both; ``gamma_origin``; ``new_state_purity`` of a `SafeRegion`.
    """
    scores = {source: classification(region, *labelled) for source, labelled in states.items()}
    wanted = ("precision", "recall", "brier")
    values = {f"{name}_{source}": score[name] for source, score in scores.items() for name in wanted}
    values["accepted_share"] = float(np.mean([score["accepted"] for score in scores.values()]))
    values["gamma_origin"] = float(region.safety(np.zeros_like(data.x[:1]))[0])
    if isinstance(region, SafeRegion):
        values["new_state_purity"] = new_state_purity(region, states, data.n_ud, config.paper.k)
    return values


def measure_regions(learned: Learned, config: Config, seed: int) -> list[Row]:
    """Rows of every measure of training data (of a seed) and of what was learned from them, by text of α."""
    rows: list[Row] = []
    states: dict[str, Labelled] = {}  # the same for all, as all data have the same MND
    for alpha, (data, region) in learned.items():
        states = states or held_out_states(data.mnd, config, np.random.default_rng([seed, 1]))
        values = measure_data(data, config)
        if isinstance(region, SafeRegion):
            values |= measure_embedding(data, region, config)
        rows += measure_rows(values | measure_hypothesis(data, region, states, config), alpha, seed=seed)
    return rows


def measure_run(
    run: TrainedRun, region: CompiledHypothesis | None = None, free: TrainedRun | None = None
) -> list[Row]:
    """Rows of every measure of one trained run, from its products: `learning`, `recoveries` and `errors`.

    region: the hypothesis behind its supervisor, if it had one; free: the run without a supervisor of the
    same Δ and seed, if there is one, about whose states every hypothesis is asked.

    Raises:
        ParameterError: the region or the free run is not that of this run.
        ResultError: a product is missing or damaged.
    """
    of, measures = run.condition, learning(run) | recoveries(run)
    check((region is None) == (of.alpha is None), "region", region, "given exactly if alpha is not none")
    check(free is None or region is not None, "common", free, "left out where there is no region")
    if free is not None:
        same = Condition(None, of.delta, of.seed)
        check(free.condition == same, "common", free.condition.name, same.name)
        require_same(free, run.config, run.steps)
    if region is not None:
        check(region.digest() == run.region, "region", region.digest(), f"{run.region}, as in {run.folder}")
        measures |= errors(run, region, free)
    return measure_rows(measures, of.alpha_text, of.delta, of.seed)


def learning(run: TrainedRun) -> dict[str, float]:
    """How well and how soon a run has learned.

    Returns:
        ``final_return``: mean return of the trials that end in the last tenth of the steps;
        ``policy_return_share``: return of the final mean policy in its own condition, over that of a perfect
        trial; ``policy_alone_share``: the same without a supervisor, 0 if it is negative: a policy that loses
        the target has nothing to show, and how far it falls would drown every other run;
        ``training_left``: share of the steps that are left when the mean return of a window first reaches
        `SATISFYING` of a perfect trial's, 0 if none does; ``last_mean_length``: of the trials that end in
        the last window, in control periods.
    """
    trials, curve, best = run.trials(), run.curve(), perfect_return(run.config)
    last = trials["step"] > run.steps_done * (1 - 1 / LAST_SHARE)
    reached = curve.loc[curve["mean_return"] >= SATISFYING * best, "step"]
    return {
        "final_return": float(trials.loc[last, "return"].mean()),
        "policy_return_share": run.returns["own condition"] / best,
        "policy_alone_share": max(0.0, run.returns["no supervisor"] / best),
        "training_left": 1 - float(reached.min()) / run.steps_done if len(reached) else 0.0,
        "last_mean_length": float(curve["mean_length"].iloc[-1]),
    }


def measure_budgets(run: TrainedRun) -> list[Row]:
    """Rows (measure, alpha, delta, seed, step, value): what a run would show, had it ended at ``step``.

    Of `learning`, at the ends of `BUDGETS` equal parts: ``final_return``, ``training_left``, and
    ``policy_alone_share`` of the first evaluation of the mean policy from that step on.
    """
    trials, curve, evaluations = run.trials(), run.curve(), run.evaluations()
    best, of = perfect_return(run.config), run.condition
    rows: list[Row] = []
    for part in range(1, BUDGETS + 1):
        step = round(run.steps * part / BUDGETS)
        last = trials["step"].between(step * (1 - 1 / LAST_SHARE), step, inclusive="right")
        reached = curve.loc[(curve["mean_return"] >= SATISFYING * best) & (curve["step"] <= step), "step"]
        values = {"final_return": float(trials.loc[last, "return"].mean())}
        values["training_left"] = 1 - float(reached.min()) / step if len(reached) else 0.0
        from_here = evaluations.loc[evaluations["step"] >= step, "return"]
        if len(from_here):
            values["policy_alone_share"] = max(0.0, float(from_here.iloc[0]) / best)
        rows += [(name, of.alpha_text, of.delta, of.seed, step, value) for name, value in values.items()]
    return rows


def recoveries(run: TrainedRun) -> dict[str, float]:
    """What K had to do, and how often it failed, over the whole training.

    Returns:
        ``activations``, ``failures`` of K, ``falls`` of π; ``violations_per_1000_steps``: failures and falls;
        ``activated_share``: of the trials, those in which K was activated;
        ``success_rate``: recovered over all where K was tried, if it was; ``success_log_odds`` of it, if
        there were activations.
    """
    counts, failures = run.counts, run.failures
    measures = {"activations": float(counts["activations"]), "failures": float(failures)}
    measures["falls"] = float(counts["falls"])
    measures["violations_per_1000_steps"] = 1000.0 * (failures + counts["falls"]) / run.steps_done
    if counts["trials"]:
        measures["activated_share"] = counts["activations"] / counts["trials"]
    if tried := counts["recovered"] + failures:
        measures["success_rate"] = counts["recovered"] / tried
    if counts["activations"]:
        measures["success_log_odds"] = log_odds(counts["recovered"], failures)
    return measures


def log_odds(recovered: float, failed: float) -> float:
    """ln of the odds that K succeeds; half a case is added to both (Haldane), so that it is always finite."""
    return float(np.log((recovered + 0.5) / (failed + 0.5)))


def errors(run: TrainedRun, region: CompiledHypothesis, free: TrainedRun | None) -> dict[str, float]:
    """Errors of h where a learner went, all states labelled on the real system.

    Returns:
        ``generalization_error``, eq. (9), ``false_positives`` and ``brier`` on the states that the run
        itself visited; ``common_error`` and ``common_false_positives`` on those of the free run, if there is
        one; `promise_gap` of a `SafeRegion`.
    """
    real = ClosedLoop.from_config(run.config, run.condition.delta)
    own = classification(region, *labelled(run.visited(), real, run.steps))
    measures = {"generalization_error": own["error"]}
    measures |= {name: own[name] for name in ("false_positives", "brier")}
    if free is not None:
        common = classification(region, *labelled(free.visited(), real, free.steps))
        measures |= {f"common_{name}": common[name] for name in ("error", "false_positives")}
    if isinstance(region, SafeRegion):
        measures["promise_gap"] = promise_gap(region, run.visited(), real)
    return measures


def labelled(visited: Floats, real: ClosedLoop, steps: int) -> Labelled:
    """(x, l(x)) of the visited states [N, 2n] of a training, thinned to one in `LABEL_EVERY` of its steps."""
    x = visited[:: max(1, LABEL_EVERY * len(visited) // steps)]
    return x, real.predict(x)


def promise_gap(region: SafeRegion, visited: Floats, real: ClosedLoop) -> float:
    """Share of safe states less mean Γ, among the visited states [N, 2n] at which K took over; NaN if none.

    Those are the states with Γ ≤ p_t: a trial ends at the first. States on the ground are falls of π, after
    which K has nothing left to do.
    """
    gamma = region.safety(visited)
    taken = (gamma <= region.p_t) & (np.abs(visited[:, 0]) < region.arrays_.scale[0])
    if not taken.any():
        return float("nan")
    return float(real.predict(visited[taken]).mean() - gamma[taken].mean())


def measure_rows(
    values: Mapping[str, float], alpha: str, delta: float | None = None, seed: int | None = None
) -> list[Row]:
    """Rows of a table of measures for one cell of the grid."""
    return [(name, alpha, delta, seed, value) for name, value in values.items()]


def write_measures(path: str | Path, rows: list[Row]) -> pd.DataFrame:
    """Write rows of `measure_rows` as a table of measures (columns as in `claims`), and return it."""
    table = pd.DataFrame(rows, columns=list(MEASURE_COLUMNS))
    write_table(Path(path), table)
    return table


def read_measures(*places: str | Path) -> pd.DataFrame:
    """Tables of measures as one; a place is a table, or a folder of tables. `ResultError`: one is none."""
    files = [f for p in map(Path, places) for f in (sorted(p.glob("*.csv")) if p.is_dir() else [p])]
    numbers = ("delta", "seed", "value")
    tables = [read_table(file, MEASURE_COLUMNS, numbers, text=("alpha",)) for file in files]
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=list(MEASURE_COLUMNS))
