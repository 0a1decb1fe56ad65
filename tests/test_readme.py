"""README.md says what the results and the configuration say."""

import pandas as pd

from srlrepro import readme
from srlrepro.claims import load


def test_readme_is_up_to_date() -> None:
    assert not readme.is_stale(), "run: python -m srlrepro readme"


def test_a_changed_result_makes_it_stale(monkeypatch) -> None:
    values = readme.context()
    values["run"]["minutes"] += 1
    monkeypatch.setattr(readme, "context", lambda: values)
    assert readme.is_stale()


def test_the_larger_set_gives_the_verdicts(monkeypatch, tmp_path) -> None:
    """Every claim stands once, beside what three seeds say; counts are of the well-posed ones."""
    claims = pd.DataFrame([vars(claim) for claim in load()])[
        ["id", "statement", "place", "paper", "ill_posed", "joins"]
    ]
    claims.assign(estimates="0.5 [0.4, 0.6]", n=10, verdict="partly").to_csv(
        tmp_path / "claims.csv", index=False
    )
    monkeypatch.setattr(readme, "LARGER", tmp_path / "claims.csv")
    text = readme.render()
    rows = [line for line in text.splitlines() if "0.5 [0.4, 0.6]" in line]
    assert len(rows) == len(claims) and all(row.endswith(" | partly |") for row in rows)
    three = pd.read_csv(readme.ROOT / "figures" / readme.RUN / "claims.csv").set_index("id")["verdict"]
    for claim in claims.itertuples():
        assert any(claim.statement in row and f" | 10 | {three[claim.id]} | partly |" in row for row in rows)
    sound = int((claims["ill_posed"] == "").sum())
    assert f"Of {sound} claims" in text and f"{sound} partly" in " ".join(text.split())
