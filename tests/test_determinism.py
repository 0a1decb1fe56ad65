"""The same results give the same bytes of tables and pictures, and each execution notes what it took."""

import json
from pathlib import Path

import pandas as pd
import pytest

from srlrepro.storage.files import write_table
from srlrepro.storage.provenance import EVERYTHING, code_hash
from workflow.notebooks import execute

ROOT = Path(__file__).parent.parent


def contents(folder: Path, *parts: str) -> dict[Path, bytes]:
    """{path: bytes} of every file below parts of a folder."""
    files = [path for part in parts for path in (folder / part).rglob("*.*")]
    return {path.relative_to(folder): path.read_bytes() for path in files}


@pytest.mark.slow
def test_the_same_measures_give_the_same_verdict(tmp_path: Path) -> None:
    """Tables with intervals and bootstraps, and the figure, of the kept grid: the same bytes twice."""
    measures = pd.read_csv(ROOT / "figures" / "full" / "measures.csv", dtype={"alpha": str})
    for part, rows in (("results", measures[::2]), ("tables", measures[1::2])):
        write_table(tmp_path / part / "measures" / "some.csv", rows)
    written = []
    for name in ("first", "second"):
        folder = tmp_path / name
        places = {
            "RESULTS": tmp_path / "results",
            "TABLES": tmp_path / "tables",
            "FIGURES": folder / "figures",
        }
        values = {key: str(path) for key, path in places.items()} | {"SETTINGS": {}, "SEEDS": [0, 1, 2]}
        execute(ROOT / "notebooks" / "08_claims.ipynb", folder / "08_claims.ipynb", values)
        written.append(contents(folder, "figures"))
        made = json.loads((folder / "08_claims.json").read_text())
        assert made["parameters"] == values and made["code"] == code_hash(EVERYTHING)
        assert made["seconds"] > 0 and made["peak_memory_mb"] > 50 and made["machine"]["cores"] >= 1
    assert {path.name for path in written[0]} >= {"verdict.png", "claims.csv", "final_performance.csv"}
    assert written[0] == written[1]
