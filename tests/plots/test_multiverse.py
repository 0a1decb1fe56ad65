"""The specification curves: which universes they show, in what order, and that all of it fits on the page."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from replication.evidence import claims
from replication.plots.multiverse import curve_table, plot_curve, plot_shares
from replication.plots.style import use_style
from replication.studies import multiverse
from replication.studies.multiverse import ALONE, RANDOM

CHOICES = multiverse.load_choices()
UNIVERSES = multiverse.design(CHOICES).iloc[:20]


def made(claim: claims.Claim) -> pd.DataFrame:
    """Outcomes of a claim by falling value, whose sign says whether it holds; the first is not evaluated."""
    values = np.linspace(1.0, -1.0, len(UNIVERSES))
    holds = pd.Series(values > 0, dtype=object)
    holds[0] = None
    return pd.DataFrame(
        {
            "id": UNIVERSES.index,
            "claim": claim.id,
            "value": values,
            "margin": values,
            "holds": holds,
            "why": "",
        }
    )


def test_a_curve_rises_over_the_universes_that_can_be_evaluated() -> None:
    claim, other = claims.load_claims()[:2]
    table = curve_table(claim, pd.concat([made(claim), made(other)]), UNIVERSES)
    assert list(table["id"]) == list(UNIVERSES.index[:0:-1])
    assert table["value"].is_monotonic_increasing and (table["holds"] == (table["value"] > 0)).all()
    pd.testing.assert_frame_equal(table[list(UNIVERSES.columns)], UNIVERSES[:0:-1].reset_index(drop=True))


def test_the_longest_statement_fits_above_its_curve() -> None:
    use_style()
    claim = max(claims.load_claims(), key=lambda c: len(c.statement))
    figure = plot_curve(claim, curve_table(claim, made(claim), UNIVERSES), len(UNIVERSES), CHOICES)
    figure.canvas.draw()
    title, page = figure.axes[0].title, figure.bbox
    assert "holds in 9 of 19 universes; 1 not evaluable" in title.get_text()
    words = title.get_window_extent()
    assert page.x0 <= words.x0 and words.x1 <= page.x1 and words.y1 <= page.y1
    plt.close(figure)


def test_a_claim_that_no_universe_can_evaluate_has_no_row() -> None:
    cells = [("a", ALONE, 0.5, 0.4, 0.6), ("a", RANDOM, 0.5, 0.4, 0.6), ("b", ALONE, np.nan, np.nan, np.nan)]
    figure = plot_shares(pd.DataFrame(cells, columns=["claim", "design", "share", "low", "high"]))
    assert [text.get_text() for text in figure.axes[0].get_yticklabels()] == ["a"]
