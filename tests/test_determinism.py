"""The same results give the same bytes of tables and pictures, and each execution notes what it took."""

import json
from pathlib import Path

import pytest

from srlrepro.notebooks import execute
from srlrepro.provenance import EVERYTHING, code_hash

ROOT = Path(__file__).parent.parent


@pytest.mark.slow
def test_a_notebook_executed_twice_gives_the_same_bytes(tmp_path: Path) -> None:
    written = []
    for name in ("first", "second"):
        folder = tmp_path / name
        values = {"RESULTS": str(folder / "results"), "FIGURES": str(folder / "figures")}
        execute(ROOT / "notebooks" / "01_pendulum.ipynb", folder / "01_pendulum.ipynb", values)
        files = [path for part in ("results", "figures") for path in (folder / part).rglob("*.*")]
        written.append({path.relative_to(folder): path.read_bytes() for path in files})
        made = json.loads((folder / "01_pendulum.json").read_text())
        assert made["parameters"] == values and made["code"] == code_hash(EVERYTHING)
        assert made["seconds"] > 0 and made["peak_memory_mb"] > 50 and made["machine"]["cores"] >= 1
    assert {path.suffix for path in written[0]} >= {".csv", ".png", ".pdf", ".gif"}
    assert written[0] == written[1]
