"""Policies and regions to take home: copies byte for byte, named after what they hold, with true cards."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from learned import Learned
from runs import CONFIG

from replication import documents, policies
from replication.__main__ import main
from replication.documents import ROOT
from srlrepro.learner.policy import TrainedPolicy, load_policy
from srlrepro.pins import ARITHMETIC
from srlrepro.region.safe_region import SafeRegion
from srlrepro.storage.files import ResultError, sha256

COUNTS = {"activations": 7, "hit_the_ground": 2, "not_recovered_in_time": 1, "falls": 4}
HELD = sorted((ROOT / documents.POLICIES).glob("*.npz"))


def write(path: Path, alpha: float | None, seed: int, **changes: object) -> Path:
    """A policy whose record says that it was trained so."""
    rng = np.random.default_rng(seed)
    shapes = [(5, 8), (3, 5)]
    weights = tuple(rng.normal(size=shape).astype(np.float32) for shape in shapes)
    biases = tuple(rng.normal(size=shape[0]).astype(np.float32) for shape in shapes)
    returned = {name: {"return": 100.25 + seed} for name in ("own condition", "no supervisor")}
    record = {
        "run": {"alpha": alpha, "delta": 1.5, "seed": seed, "steps": 100},
        "config": CONFIG.as_dict(),
        "region": "NoneType",
        "steps_done": 128,
        "counts": COUNTS,
        "final_policy": returned,
        "arithmetic": ARITHMETIC,
    }
    ones = np.ones(3, np.float32)
    TrainedPolicy(weights, biases, -ones, ones, record | changes).save(path)
    return path


@pytest.fixture
def folder(small: Learned, tmp_path: Path) -> Path:
    """A folder of two seeds of a supervised condition, a free one, and the region behind the first."""
    region = small[1]
    region.save(tmp_path / "region.npz")
    made = [tmp_path / "region.npz"]
    for name, alpha, seed in (("a", 0.5, 0), ("b", 0.5, 1), ("c", None, 0)):
        digest = {} if alpha is None else {"region": region.digest()}
        made.append(write(tmp_path / f"{name}.npz", alpha, seed, **digest))
    out = tmp_path / documents.POLICIES
    assert main(["policies", *map(str, made), "--out", str(out)]) == 0
    for path, source in zip(sorted(out.iterdir()), [made[1], made[2], made[3], made[0]], strict=True):
        assert path.read_bytes() == source.read_bytes()
    return out


def test_files_are_named_after_what_they_hold(folder: Path) -> None:
    assert sorted(path.name for path in folder.iterdir()) == [
        "alpha_0.5__delta_1.5__seed_0.npz",
        "alpha_0.5__delta_1.5__seed_1.npz",
        "alpha_none__delta_1.5__seed_0.npz",
        "region__alpha_0.5__data_0.npz",
    ]
    (folder / "alpha_none__delta_1.5__seed_0.npz").rename(folder / "alpha_none__delta_4__seed_0.npz")
    with pytest.raises(ResultError, match=r"delta_4__seed_0\.npz holds alpha_none__delta_1.5__seed_0"):
        policies.facts(folder, "alpha_none__delta_4.md")


def test_nothing_is_copied_if_one_file_is_none(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "broken.npz").write_bytes(b"PK")
    files = [str(tmp_path / "a.npz"), str(tmp_path / "broken.npz")]
    assert main(["policies", *files, "--out", str(tmp_path / "out")]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "broken.npz" in error and not (tmp_path / "out").exists()
    write(tmp_path / "d.npz", 0.5, 3, counts=None)
    with pytest.raises(ResultError, match=r"d\.npz is not of a training run"):
        policies.take([tmp_path / "d.npz"], tmp_path / "out")


def test_cards_tell_what_the_files_hold(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(documents, "ROOT", folder.parent)
    cards = [document for document in documents.documents() if document.startswith("policies/")]
    names = ["README", "alpha_0.5__delta_1.5", "alpha_none__delta_1.5", "region__alpha_0.5__data_0"]
    assert cards == [f"policies/{name}.md" for name in names]
    index, supervised, free, region = (documents.render(card) for card in cards)
    for text in (supervised, index):
        assert "100" in text and "101" in text
    assert "| 100.2 |" in supervised and "| 7 | 3 | 4 |" in supervised
    for seed in (0, 1):
        assert sha256(folder / f"alpha_0.5__delta_1.5__seed_{seed}.npz") in supervised
    assert "(region__alpha_0.5__data_0.md)" in supervised and "supervisor |" not in free
    assert "k = " not in free and "hidden_width" in free  # what was varied is said
    assert sha256(folder / "region__alpha_0.5__data_0.npz") in region
    assert SafeRegion.load(folder / "region__alpha_0.5__data_0.npz").digest() in region
    assert "| network 6 → 32 → 32 → 2 |" in region and "- **Ψ**: a neural regression" in region
    for text in (index, supervised, free, region):
        assert not re.search(r"\bnan\b|\bNone\b|Undefined", text)
        for link in re.findall(r"\]\(([^)]+)\)", text):
            assert (folder / link).exists() or f"policies/{link}" in cards, link


def test_a_card_tells_of_neighbours(small: Learned, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = small[0]
    other = CONFIG.with_values(psi="neighbours", gamma_evidence="held out", k=len(data.x) - 1)
    region = SafeRegion.from_config(other).fit_embedding(data.x, data.z, data.x[:, :2])
    assert data.made_of is not None
    region.made_of_ = replace(data.made_of, values=other.until("region"))
    folder = tmp_path / documents.POLICIES
    folder.mkdir()
    region.save(folder / "region__alpha_0.5__data_0.npz")
    monkeypatch.setattr(documents, "ROOT", tmp_path)
    card = documents.render("policies/region__alpha_0.5__data_0.md")
    assert "| 16 nearest neighbours |" in card and "among their nearest neighbours" in card
    assert "where Ψ puts states that it has not learned" in card and "network" not in card


def test_seeds_that_were_trained_otherwise_share_no_card(folder: Path) -> None:
    path = folder / "alpha_0.5__delta_1.5__seed_1.npz"
    write(path, 0.5, 1, steps_done=64)
    with pytest.raises(ResultError, match=r"alpha_0\.5__delta_1\.5\.md: its seeds were not trained alike"):
        policies.facts(folder, "alpha_0.5__delta_1.5.md")


def test_without_policies_there_is_no_card(tmp_path: Path) -> None:
    assert policies.cards(tmp_path / "nothing") == {}


def test_the_kept_ones_are_read_and_their_snippets_run() -> None:
    assert HELD and sum(path.stat().st_size for path in HELD) < 8e6
    assert json.dumps(load_policy(HELD[0]).record)
    texts = [path.read_text("utf-8") for path in sorted((ROOT / documents.POLICIES).glob("*.md"))]
    blocks = [block for text in texts for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL)]
    assert len(blocks) == len(texts)
    subprocess.run([sys.executable, "-c", "".join(blocks)], cwd=ROOT, check=True, capture_output=True)
