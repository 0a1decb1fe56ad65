"""The same results give the same bytes of tables and pictures, and each execution notes what it took."""

import json
from dataclasses import asdict
from pathlib import Path

import pandas as pd
import pytest

from srlrepro.learner.training import Run
from srlrepro.pins import ARITHMETIC
from srlrepro.settings.choices import Choices
from srlrepro.settings.condition import parse_alpha
from srlrepro.settings.config import Config
from srlrepro.storage.files import write_json, write_table
from workflow.notebooks import execute
from workflow.sources import code_of

ROOT = Path(__file__).parent.parent


COUNTS = dict.fromkeys(
    ("recovered", "hit_the_ground", "not_recovered_in_time"), 0
)  # which nothing reads here


def contents(folder: Path, *parts: str) -> dict[Path, bytes]:
    """{path: bytes} of every file below parts of a folder."""
    files = [path for part in parts for path in (folder / part).rglob("*.*")]
    return {path.relative_to(folder): path.read_bytes() for path in files}


def kept_results(folder: Path) -> list[str]:
    """Lay the measures of the kept grid out as its jobs left them; returns the names of its runs."""
    measures = pd.read_csv(ROOT / "figures" / "full" / "measures.csv", dtype={"alpha": str})
    of_runs = measures["alpha"].notna() & measures["delta"].notna()
    values, names = Config().as_dict(), []
    for (alpha, delta, seed), rows in measures[of_runs].groupby(["alpha", "delta", "seed"]):
        run = Run(parse_alpha(str(alpha)), float(delta), int(seed), Choices.total_steps)
        record = {"run": asdict(run), "config": values, "region": "", "steps_done": run.steps}
        record |= {"arithmetic": ARITHMETIC}
        write_json(folder / "runs" / run.name / "run.json", record | {"counts": COUNTS, "final_policy": {}})
        write_table(folder / "runs" / run.name / "measures.csv", rows)
        names.append(run.name)
    write_table(folder / "measures" / "01_pendulum.csv", measures[~of_runs & measures["seed"].isna()])
    for seed, rows in measures[~of_runs].groupby("seed"):
        for part, stage in enumerate(("02_training_data", "03_embedding", "04_safe_region")):
            write_table(folder / "measures" / f"{stage}__data_{int(seed)}.csv", rows.iloc[part::3])
    return names


@pytest.mark.slow
def test_the_same_measures_give_the_same_verdict(tmp_path: Path) -> None:
    """Tables with intervals and bootstraps, and the figure, of the kept grid: the same bytes twice."""
    names, written = kept_results(tmp_path / "results"), []
    for name in ("first", "second"):
        folder = tmp_path / name
        values = {"RESULTS": str(tmp_path / "results"), "MEASURES": str(tmp_path / "results" / "measures")}
        values |= {"FIGURES": str(folder / "figures"), "SETTINGS": {}, "SEEDS": [0, 1, 2], "NOTE": ""}
        values |= {"RUNS": names, "STEPS": Choices.total_steps}
        execute(ROOT / "notebooks" / "08_claims.ipynb", folder / "08_claims.ipynb", values)
        written.append(contents(folder, "figures"))
        made = json.loads((folder / "08_claims.json").read_text())
        assert made["parameters"] == values and made["code"] == code_of("notebooks/08_claims.ipynb")
        assert made["seconds"] > 0 and made["peak_memory_mb"] > 50 and made["machine"]["cores"] >= 1
    tables = {path: content for path, content in written[0].items() if path.suffix == ".csv"}
    assert {path.name for path in tables} >= {"claims.csv", "contrasts.csv", "final_performance.csv"}
    assert tables == {path: written[1][path] for path in tables}
    verdicts = [
        pd.read_csv(place / "claims.csv")["verdict"] for place in (ROOT / "figures/full", folder / "figures")
    ]
    assert verdicts[0].equals(verdicts[1])
