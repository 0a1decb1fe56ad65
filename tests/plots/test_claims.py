"""The pictures of the claims show every claim, every sign and every run, and all of it lies on the page."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from judged import BUDGETS, SEEDS, SUCCESS, budgets, measures
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from replication.evidence.claims import RATES, judge_claims, load_claims
from replication.evidence.verdicts import AS_WRITTEN, CALIBRATED, by_budget, failure_rates, matrix
from replication.plots.claims import plot_budgets, plot_failures, plot_matrix
from replication.plots.style import PAPERS_NUMBER, use_style

CLAIMS = load_claims()
PAPERS = [claim for claim in CLAIMS if claim.id in RATES]


def on_the_page(figure: Figure) -> list[str]:
    """The texts of a figure, all of which lie within it."""
    figure.canvas.draw()
    texts = [text for ax in figure.axes for text in (*ax.get_yticklabels(), *ax.texts) if text.get_text()]
    for text in texts:
        box = text.get_window_extent()
        assert figure.bbox.x0 <= box.x0 and box.x1 <= figure.bbox.x1, text
        assert figure.bbox.y0 <= box.y0 and box.y1 <= figure.bbox.y1, text
    plt.close(figure)
    return [text.get_text() for text in texts]


def plain(text: str) -> str:
    return text.replace("\n", " ").replace("\N{NO-BREAK SPACE}", " ")


@pytest.mark.parametrize("turned", [False, True])
def test_the_matrix_shows_every_claim_and_sign(turned: bool) -> None:
    use_style()
    signs = matrix(CLAIMS, judge_claims(CLAIMS, measures(turned))[1])
    texts = [plain(text) for text in on_the_page(plot_matrix(signs))]
    assert {row.rstrip(".") for row in signs["row"]} <= set(texts)
    shown = signs.drop(columns=["layer", "row"]).to_numpy().ravel()
    for sign in set(shown) - {""}:
        assert texts.count(sign) == (shown == sign).sum()


def test_the_signs_by_step_have_a_row_for_each_claim_and_delta() -> None:
    use_style()
    table = by_budget(CLAIMS, budgets())
    texts = on_the_page(plot_budgets(table))
    assert len(texts) == len(table) + len(table) // len(BUDGETS)
    assert sum("(Δ = 4)" in plain(text) for text in texts) > 1


def test_every_run_is_a_dot_and_the_papers_rates_lie_beside() -> None:
    """Both arms in every panel; the paper's failures at the first Δ alone, where ours agree with them."""
    use_style()
    rates = failure_rates(measures())
    both = pd.concat([rates.assign(arm=AS_WRITTEN), rates.assign(arm=CALIBRATED)])
    figure = plot_failures(both, PAPERS, judge_claims(PAPERS, measures())[1])
    for ax, delta in zip(figure.axes, SUCCESS, strict=True):
        dots = np.concatenate([np.asarray(part.get_offsets()) for part in ax.collections])
        assert len(dots) == 2 * 3 * SEEDS and ax.get_yscale() == "log"
        brown = [line for line in ax.lines if to_rgba(line.get_color()) == to_rgba(PAPERS_NUMBER)]
        marks = sorted(float(line.get_ydata()[0]) for line in brown if line.get_marker() == "D")
        assert marks == pytest.approx([0.003, 0.09, 0.192] if delta == 1.1 else [], rel=1e-3)
        for line in (line for line in brown if line.get_marker() != "D"):
            low, high = sorted(np.asarray(line.get_ydata(), float))
            assert any(low < mark < high for mark in marks)
    plt.close(figure)
