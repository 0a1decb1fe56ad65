"""What README.md is filled with: results of the paper's grid, measured times, the ledger."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import pandas as pd

from replication.documents import FIGURES, ROOT, TEMPLATES, Document
from replication.evidence.measures import TEST_STATES
from replication.evidence.verdicts import THREE, judged
from replication.studies.multiverse import design, load
from srlrepro.settings.choices import Choices
from srlrepro.settings.paper import Paper
from srlrepro.storage.files import LARGEST, read_json, read_table, write_json

TEST_TIME, QUICK_TIME = TEMPLATES / "test_time.json", TEMPLATES / "quick_time.json"
BENCHMARK, OVERHEAD = TEMPLATES / "benchmark.csv", TEMPLATES / "overhead.csv"
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


def context(figures: Path = FIGURES) -> dict[str, Any]:
    """What the template is filled with.

    Raises:
        ResultError: a table of the results is missing.
    """
    measures = read_table(figures / THREE / "measures.csv", ("measure", "alpha", "delta", "seed", "value"))
    supervising = measures[measures["delta"].isna() & (measures["seed"] == 0)]  # the data that all runs use
    regions = supervising.pivot_table(index="alpha", columns="measure", values="value")
    stability = measures[measures["measure"] == "spectral_radius"].set_index("delta")["value"]
    values = judged(figures)
    return values | {
        "learning": _learning(measures[measures["delta"].notna() & measures["alpha"].notna()]),
        "benchmark": read_table(BENCHMARK, ("work", "ratio")).to_dict("records"),
        "quick": read_json(QUICK_TIME),
        "k": Paper.k,
        "test_states": TEST_STATES,
        "universes": len(design(load())),
        "largest": LARGEST // 2**20,
        "stated": _parameters(Paper, "place"),
        "chosen": _parameters(Choices, "reason"),
        "regions": {f"{float(str(a)):g}": row.to_dict() for a, row in regions.iterrows()},
        "stability": {f"{d:g}": r for d, r in stability.items()},
        "costs": _costs(values["run"], values["conditions"]),
        "overhead": read_table(OVERHEAD, ("cells", "dry_run_cpu_s")).to_dict("records"),
        "test": read_json(TEST_TIME),
    }


DOCUMENT = Document("README.md", "readme", context)


def keep_times() -> None:
    """Keep the times of the last complete tests and --quick run here, if there were any, for the README."""
    for measured, kept in (
        (ROOT / "results" / "test_time.json", TEST_TIME),
        (ROOT / "figures" / "quick" / "run_time.json", QUICK_TIME),
    ):
        if measured.exists():
            write_json(kept, read_json(measured))
