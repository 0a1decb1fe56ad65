"""The RO-Crate of the results, by a published validator."""

import json
import subprocess
import sys
from importlib.resources import files
from io import BytesIO
from pathlib import Path

import pytest
import requests
from requests.adapters import BaseAdapter, HTTPAdapter
from requests_cache import CachedSession
from urllib3 import HTTPResponse

from srlrepro.crate import PROCESS_RUN, describe
from srlrepro.jobs import ROOT

CONTEXT = "https://w3id.org/ro/crate/1.1/context"
TYPE = {"Content-Type": "application/ld+json"}


class Shipped(BaseAdapter):
    """Serves the terms of RO-Crate that the library ships (a later version's, which adds to the earlier)."""

    def send(self, request, **_) -> requests.Response:
        body = (files("rocrate") / "data" / "ro-crate.jsonld").read_bytes()
        raw = HTTPResponse(BytesIO(body), TYPE, 200, preload_content=False, request_url=request.url)
        return HTTPAdapter().build_response(request, raw)

    def close(self) -> None:
        """Nothing is open."""


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the validator would else fetch from the network."""
    path = tmp_path_factory.mktemp("cache") / "http"
    session = CachedSession(str(path), backend="sqlite", expire_after=-1)
    session.mount("https://", Shipped())
    session.get(CONTEXT, headers={"Accept": "application/ld+json"})
    session.close()
    return path


@pytest.fixture(scope="module")
def metadata() -> dict:
    return describe(("full",)).metadata.generate()


@pytest.mark.slow
def test_every_file_of_the_crate_is_there_and_made_by_an_action(metadata: dict) -> None:
    graph = {entity["@id"]: entity for entity in metadata["@graph"]}
    described = [path for path, e in graph.items() if "File" in e["@type"]]
    assert all((ROOT / path).is_file() for path in described)
    made = {r["@id"] for e in graph.values() if e["@type"] == "CreateAction" for r in e["result"]}
    assert {p.relative_to(ROOT).as_posix() for p in (ROOT / "figures" / "full").glob("*.png")} <= made
    assert graph["./"]["conformsTo"]["@id"] == PROCESS_RUN


@pytest.mark.slow
def test_the_same_results_give_the_same_crate(metadata: dict) -> None:
    assert json.dumps(describe(("full",)).metadata.generate()) == json.dumps(metadata)


def test_without_its_library_one_line_says_what_to_install() -> None:
    code = "import sys; sys.modules['rocrate'] = None\n"
    code += "from srlrepro.__main__ import main; sys.exit(main(['crate']))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 1 and done.stdout == "" and done.stderr.count("\n") == 1
    assert "pip install -r requirements-test.txt" in done.stderr


@pytest.mark.slow
def test_the_crate_is_valid(metadata: dict, cache: Path, tmp_path: Path) -> None:
    """By all required checks of Process Run Crate 0.5 and RO-Crate 1.1, on which it rests; none skipped."""
    for path in ("figures", "notebooks", "srlrepro", "Snakefile", "rules"):
        (tmp_path / path).symlink_to(ROOT / path)
    (tmp_path / "ro-crate-metadata.json").write_text(json.dumps(metadata))
    report = tmp_path / "report.json"
    command = [str(Path(sys.executable).parent / "rocrate-validator"), "-y", "validate"]
    command += ["-np", "-p", "process-run-crate-0.5", "--offline", "--cache-path", str(cache)]
    done = subprocess.run([*command, "-f", "json", "-o", report, tmp_path], capture_output=True, text=True)
    assert report.exists(), done.stdout + done.stderr
    found = json.loads(report.read_text())
    assert found["passed"] and found["statistics"]["total_passed_checks"] >= 38, found["issues"]
    # The validator's own count of what it left out, not a test that is skipped here.
    assert found["skipped_checks"] == 0, found["skipped_check_details"]
