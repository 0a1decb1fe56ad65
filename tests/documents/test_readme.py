"""README.md says what the results and the configuration say."""

from dataclasses import replace
from pathlib import Path

import pandas as pd

from replication import readme
from replication.documents import FIGURES
from replication.evidence.claims import load

DOCUMENT = readme.DOCUMENT


def test_readme_is_up_to_date() -> None:
    assert not DOCUMENT.is_stale(), "run: python -m srlrepro readme"


def test_a_changed_result_makes_it_stale() -> None:
    values = readme.context()
    values["run"]["minutes"] += 1
    assert replace(DOCUMENT, context=lambda: values).is_stale()


def test_the_larger_set_gives_the_verdicts(larger: Path) -> None:
    """Every claim stands once, beside what three seeds say; counts are of the well-posed ones."""
    text = replace(DOCUMENT, context=lambda: readme.context(larger)).render()
    rows = [line for line in text.splitlines() if "0.5 [0.4, 0.6]" in line]
    claims = load()
    assert len(rows) == len(claims) and all(row.endswith(" | partly |") for row in rows)
    three = pd.read_csv(FIGURES / "full" / "claims.csv").set_index("id")["verdict"]
    for claim in claims:
        assert any(claim.statement in row and f" | 10 | {three[claim.id]} | partly |" in row for row in rows)
    sound = sum(not claim.ill_posed for claim in claims)
    assert f"Of {sound} claims" in text and f"{sound} partly" in " ".join(text.split())


def test_what_has_not_been_run_is_named(larger: Path) -> None:
    opened = "Open at this point, and not claimed: "
    text = replace(DOCUMENT, context=lambda: readme.context(larger)).render()
    assert f"{opened}the multiverse; learners under other hypotheses." in text
    (larger / "seeds_10" / "claims.csv").unlink()
    text = replace(DOCUMENT, context=lambda: readme.context(larger)).render()
    assert f"{opened}verdicts on a larger set of seeds; " in text
