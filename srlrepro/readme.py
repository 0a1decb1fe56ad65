"""README.md from its template: every number in it comes from the results and the configuration."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd

from srlrepro.claims import VERDICTS
from srlrepro.config import Choices, Paper
from srlrepro.evaluation import TEST_STATES
from srlrepro.files import beside, read_json, read_table, write_json

ROOT = Path(__file__).resolve().parent.parent
TEMPLATE, README = ROOT / "docs" / "README.md.jinja", ROOT / "README.md"
TEST_TIME, QUICK_TIME = ROOT / "docs" / "test_time.json", ROOT / "docs" / "quick_time.json"
BENCHMARK, OVERHEAD = ROOT / "docs" / "benchmark.csv", ROOT / "docs" / "overhead.csv"
RUN = "full"  # the results that the README shows: the paper's three seeds
LARGER = ROOT / "figures" / "seeds_10" / "claims.csv"  # the verdicts rest on these
CLAIM_COLUMNS = ("id", "statement", "place", "paper", "estimates", "points", "verdict", "ill_posed", "joins")
MORE_SEEDS = (10, 100, 1000)
LEARNING = ("final_return", "policy_return_share", "success_rate", "activations", "failures", "falls")


def _value(value: object) -> str:
    return (
        f"{value:.6g}"
        if isinstance(value, float)
        else str(value).lower()
        if isinstance(value, bool)
        else str(value)
    )


def _parameters(part: type, source: str) -> list[dict[str, str]]:
    return [
        {
            "name": f.name,
            "value": _value(f.default),
            "unit": f.metadata["unit"],
            "meaning": f.metadata["meaning"],
            "why": f.metadata[source],
        }
        for f in fields(part)
    ]


def _learning(runs: pd.DataFrame) -> list[dict[str, Any]]:
    """Per Δ and α: for each measure of `LEARNING` the mean over seeds, and the seeds one by one."""
    rows = []
    for (delta, alpha), group in runs.groupby(["delta", "alpha"]):
        values = group.pivot_table(index="seed", columns="measure", values="value")
        row: dict[str, Any] = {"delta": f"{delta:g}", "alpha": str(alpha)}
        for name in LEARNING:
            seeds = values[name].tolist() if name in values else []
            row[name] = {"mean": sum(seeds) / len(seeds) if seeds else None, "seeds": seeds}
        rows.append(row)
    return rows


def _larger(three: pd.DataFrame) -> list[dict[Any, Any]]:
    """The claims as the larger set judges them, with the verdict of three seeds; empty without that set."""
    if not LARGER.exists():
        return []
    columns = ("id", "statement", "place", "paper", "estimates", "n", "verdict", "ill_posed", "joins")
    verdicts = three[["id", "verdict"]].rename(columns={"verdict": "verdict_of_three"})
    return read_table(LARGER, columns).merge(verdicts, on="id", how="left").fillna("").to_dict("records")


def _costs(run: dict[str, Any], conditions: int) -> list[dict[str, float]]:
    """Core hours of the trainings of more seeds, each as long as those measured were on average; empty
    where the time of the results was kept without that of the trainings."""
    if not run.get("trainings"):
        return []
    each = run["core_hours"] / run["trainings"]
    return [
        {"seeds": seeds, "trainings": conditions * seeds, "core_hours": each * conditions * seeds}
        for seeds in MORE_SEEDS
    ]


def context() -> dict[str, Any]:
    """What the template is filled with.

    Raises:
        ResultError: a table of the results is missing.
    """
    figures = ROOT / "figures" / RUN
    measures = read_table(figures / "measures.csv", ("measure", "alpha", "delta", "seed", "value"))
    supervising = measures[measures["delta"].isna() & (measures["seed"] == 0)]  # the data that all runs use
    regions = supervising.pivot_table(index="alpha", columns="measure", values="value")
    stability = measures[measures["measure"] == "spectral_radius"].set_index("delta")["value"]
    runs = measures[measures["delta"].notna() & measures["alpha"].notna()]
    claims = read_table(figures / "claims.csv", CLAIM_COLUMNS)
    run, cells = read_json(figures / "run_time.json"), runs[["alpha", "delta", "seed"]].drop_duplicates()
    return {
        "claims": claims.fillna("").to_dict("records"),
        "larger": _larger(claims),
        "verdicts": VERDICTS,
        "learning": _learning(runs),
        "benchmark": read_table(BENCHMARK, ("work", "ratio")).to_dict("records"),
        "quick": read_json(QUICK_TIME),
        "k": Paper.k,
        "best": Paper.reward_constant * round(Choices.trial_length / Choices.control_period),
        "test_states": TEST_STATES,
        "stated": _parameters(Paper, "place"),
        "chosen": _parameters(Choices, "reason"),
        "regions": {f"{float(str(a)):g}": row.to_dict() for a, row in regions.iterrows()},
        "stability": {f"{d:g}": r for d, r in stability.items()},
        "run": run,
        "costs": _costs(run, len(cells[["alpha", "delta"]].drop_duplicates())),
        "overhead": read_table(OVERHEAD, ("cells", "dry_run_cpu_s")).to_dict("records"),
        "runs": len(cells),
        "seeds": runs["seed"].nunique(),
        "test": read_json(TEST_TIME),
    }


def render() -> str:
    """The README's text."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATE.parent),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(TEMPLATE.name).render(context())


def is_stale() -> bool:
    """Whether README.md differs from what the results and the configuration say."""
    return not README.exists() or README.read_text(encoding="utf-8") != render()


def write() -> None:
    """Render README.md, with the times of the last complete tests and --quick run here, if there were any."""
    for measured, kept in (
        (ROOT / "results" / "test_time.json", TEST_TIME),
        (ROOT / "figures" / "quick" / "run_time.json", QUICK_TIME),
    ):
        if measured.exists():
            write_json(kept, read_json(measured))
    text = render()
    with beside(README) as temporary:
        temporary.write_text(text, encoding="utf-8")
