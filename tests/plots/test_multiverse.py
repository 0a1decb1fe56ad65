"""The specification curves: which universes they show, in what order, and that all of it fits on the page."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from replication.evidence import claims
from replication.plots.multiverse import constant_claims, curve_table, plot_curve, plot_shares
from replication.plots.style import BACKGROUND, use_style
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
    figure = plot_curve(claim, curve_table(claim, made(claim), UNIVERSES), len(UNIVERSES), CHOICES, {})
    figure.canvas.draw()
    title, page = figure.axes[0].title, figure.bbox
    assert "holds in 9 of 19 universes; 1 not evaluable" in title.get_text()
    words = title.get_window_extent()
    assert page.x0 <= words.x0 and words.x1 <= page.x1 and words.y1 <= page.y1
    plt.close(figure)


def test_values_that_differ_by_rounding_alone_keep_the_order_of_the_design() -> None:
    """Else the dust of sums would order them, and the rows of the choices below would show a pattern."""
    claim = claims.load_claims()[0]
    dust = made(claim).assign(value=0.5 + 1e-12 * np.cos(np.arange(len(UNIVERSES))))
    table = curve_table(claim, dust, UNIVERSES)
    assert list(table["id"]) == list(UNIVERSES.index[1:])
    assert constant_claims(dust) == {claim.id} and constant_claims(made(claim)) == set()


def test_the_choice_with_the_largest_effect_stands_first() -> None:
    claim = claims.load_claims()[0]
    effects = {CHOICES[3].id: 0.4, CHOICES[5].id: 0.6}
    figure = plot_curve(claim, curve_table(claim, made(claim), UNIVERSES), len(UNIVERSES), CHOICES, effects)
    rows = [text.get_text() for text in figure.axes[1].get_yticklabels()]
    assert rows[0].startswith(f"{CHOICES[5].id}:") and rows[0].endswith("0.60")
    assert rows[1].startswith(f"{CHOICES[3].id}:") and rows[2].startswith(f"{CHOICES[0].id}:")
    codes = figure.axes[1].images[0].get_array()
    names = [level.level for level in CHOICES[5].levels]
    expected = [names.index(v) for v in curve_table(claim, made(claim), UNIVERSES)[CHOICES[5].id]]
    assert codes[0].tolist() == expected


def test_a_far_value_does_not_flatten_the_others() -> None:
    claim = next(c for c in claims.load_claims() if c.kind == "less")
    for far, scale in ((2.0, "linear"), (-500.0, "symlog")):
        table = made(claim)
        table.loc[1, "value"] = far
        figure = plot_curve(claim, curve_table(claim, table, UNIVERSES), len(UNIVERSES), CHOICES, {})
        assert figure.axes[0].get_yscale() == scale


def test_a_claim_that_no_universe_can_evaluate_has_no_row() -> None:
    cells = [("a", ALONE, 0.5, 0.4, 0.6), ("a", RANDOM, 0.5, 0.4, 0.6), ("b", ALONE, np.nan, np.nan, np.nan)]
    table = pd.DataFrame(cells, columns=["claim", "design", "share", "low", "high"])
    figure = plot_shares(table, {"a": "It holds."}, {}, set())
    assert [text.get_text() for text in figure.axes[0].get_yticklabels()] == ["It holds."]


def test_shares_of_constant_claims_stand_below_and_chance_beside_the_others() -> None:
    cells = [(name, RANDOM, 0.5, 0.4, 0.6) for name in "abc"]
    table = pd.DataFrame(cells, columns=["claim", "design", "share", "low", "high"])
    figure = plot_shares(table, {n: n.upper() for n in "abc"}, {"a": 0.25, "b": 0.125}, {"b"})
    ax = figure.axes[0]
    assert [text.get_text() for text in ax.get_yticklabels()] == ["B", "C", "A"]
    (marks,) = [line for line in ax.lines if line.get_label() == "by chance"]
    assert marks.get_xydata().tolist() == [[0.25, 2]]
    open_markers = [line for line in ax.lines if line.get_markerfacecolor() == BACKGROUND]
    assert [list(line.get_ydata()) for line in open_markers if len(line.get_ydata())] == [[-0.14]]
