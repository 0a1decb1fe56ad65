"""Measures for claims that were joined later, from what is stored of regions and runs; nothing is trained.

They stand apart from `evaluation`, on which every training run depends.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.spatial.distance import cdist

from replication.evidence.measures import classification
from srlrepro.dynamics.circle_env import perfect_return
from srlrepro.dynamics.closed_loop import ClosedLoop, Labels
from srlrepro.dynamics.pendulum import Floats
from srlrepro.region.hypothesis import CompiledHypothesis
from srlrepro.region.safe_region import SafeRegion
from srlrepro.region.tsne import label_purity
from srlrepro.settings.config import Config
from srlrepro.storage.files import read_json, read_table

SATISFYING = 0.75  # of a perfect trial's return, as for "satisfying-policy" in claims.toml


def new_state_purity(
    region: SafeRegion, states: Mapping[str, tuple[Floats, Labels]], n_ud: int, k: int
) -> float:
    """Label purity among the places Ψ(x) of k states that t-SNE has not seen, n_ud of them from UD.

    states: fresh ones of both distributions, as `evaluation.test_states` draws them.
    """
    (ud, ud_labels), (mnd, mnd_labels) = states["UD"], states["MND"]
    y = region.transform(np.concatenate([ud[:n_ud], mnd[: k - n_ud]]))
    return label_purity(cdist(y, y), np.concatenate([ud_labels[:n_ud], mnd_labels[: k - n_ud]]))


def learning_measures(folder: str | Path) -> dict[str, float]:
    """How soon the run in a folder has learned, and what its final policy can do alone.

    ``training_left``: share of the steps that are left when the mean return of a window first reaches
    `SATISFYING` of a perfect trial's, 0 if none does; ``policy_alone_share``: return of the final mean policy
    without a supervisor over that of a perfect trial, 0 if it is negative: a policy that loses the target has
    nothing to show, and how far it falls would drown every other run.

    Raises:
        ResultError: the run has not been made.
    """
    result = read_json(Path(folder, "run.json"))
    curve = read_table(Path(folder, "curve.csv"), ("step", "mean_return"))
    best = perfect_return(Config().with_values(**result["config"]))
    reached = curve.loc[curve["mean_return"] >= SATISFYING * best, "step"]
    return {
        "training_left": 1 - float(reached.min()) / result["steps_done"] if len(reached) else 0.0,
        "policy_alone_share": max(0.0, result["final_policy"]["no supervisor"]["return"] / best),
    }


def success_log_odds(recovered: float, failed: float) -> float:
    """ln of the odds that K succeeds; half a case is added to both (Haldane), so that it is always finite."""
    return float(np.log((recovered + 0.5) / (failed + 0.5)))


def common_errors(region: CompiledHypothesis, x: Floats, labels: Labels) -> dict[str, float]:
    """ε(h, l) of eq. (9) and its false positives, on states x [B, 6] that every region is asked about."""
    scores = classification(region, x, labels)
    return {"common_error": scores["error"], "common_false_positives": scores["false_positives"]}


def promise_gap(region: SafeRegion, visited: Floats, real: ClosedLoop) -> float:
    """Share of safe states less mean Γ, among the visited states [N, 6] at which K took over; NaN if none.

    Those are the states with Γ ≤ p_t: a trial ends at the first. States on the ground are falls of π, after
    which K has nothing left to do.
    """
    gamma = region.safety(visited)
    taken = (gamma <= region.p_t) & (np.abs(visited[:, 0]) < region.state_max[0])
    if not taken.any():
        return float("nan")
    return float(real.predict(visited[taken]).mean() - gamma[taken].mean())
