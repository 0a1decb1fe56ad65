"""The page as a file: whole, of its own, and made of what the package says."""

import base64
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from learned import Learned
from stored import save_policy

from replication.__main__ import main
from replication.explorer import build
from replication.explorer.equations import motion
from replication.plots import style
from replication.studies.designs import CALIBRATED
from srlrepro.dynamics.closed_loop import ClosedLoop
from srlrepro.region.safe_region import learn_region
from srlrepro.settings.config import Config

ROOM = Path(build.__file__).parent
COMMITTED = Path(__file__).parents[2] / "docs" / "explorer.html"
MOST = 3e6  # bytes of the page


def unpacked(value: dict[str, str]) -> Any:
    return np.frombuffer(base64.b64decode(value["base64"]), value["kind"])


def data_of(page: Path) -> dict[str, Any]:
    found = re.search(
        r'<script type="application/json" id="data">(.*?)</script>', page.read_text(), re.DOTALL
    )
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])
    return data


def test_the_page_needs_nothing_else(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert not re.search(r"(?:src|href)=|@import|url\(|fetch\(|XMLHttpRequest|import\(", text)
    assert not re.search(r"https?://", text)
    assert "default-src 'none'" in text


def test_the_committed_page_is_small_and_of_these_templates() -> None:
    assert COMMITTED.stat().st_size <= MOST
    assert COMMITTED.read_text("utf-8") == build.render(data_of(COMMITTED)), (
        "run python -m replication explorer"
    )


def test_twelve_policies_and_three_regions_fit() -> None:
    """By what is packed of each of them in full size: 4/3 of its bytes, and the templates."""
    c = Config()
    k, width, cells = c.paper.k + 1, c.paper.hidden_width, c.choices.gamma_cells
    policy = 4 * (8 * width + width + width * width + width + 3 * width + 3)
    units = c.choices.psi_width
    network = 6 * units + units + units**2 + units + 2 * units + 2
    region = 8 * (6 * k + 2 * k + 2 * cells**2 + network) + k
    tests = 2 * build.TEST_STATES * (6 * 4 + len(build.DELTAS))
    templates = sum(path.stat().st_size for path in ROOM.iterdir() if path.is_file())
    assert 4 / 3 * (12 * policy + 3 * region + tests) + templates < 0.97 * MOST


def test_the_page_has_the_same_bytes_each_time(
    parts: Path, page: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(build, "TEST_STATES", 30)
    assert page.read_text("utf-8") == build.render(build.collect(parts, parts))


def test_equations_do_not_depend_on_the_order_of_sets() -> None:
    code = "from replication.explorer.equations import motion; print(motion(3))"
    for seed in ("1", "2"):
        done = subprocess.run(
            [sys.executable, "-c", code], env={"PYTHONHASHSEED": seed, "PYTHONPATH": ":".join(sys.path)},
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        assert done.stdout == f"{motion(3)}\n"


def test_arms_are_as_stored_and_as_the_calibrated_study_learns(small: Learned, small_config: Config) -> None:
    data, region = small
    written, calibrated = build.arms(region).values()
    assert written is region
    study = learn_region(data, small_config.with_values(**CALIBRATED))
    assert calibrated.get_params() == study.get_params() != region.get_params()
    for name in ("x_train", "y_train", "gamma", "origin"):
        found, expected = getattr(calibrated.arrays_, name), getattr(study.arrays_, name)
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-15)


def test_a_region_is_packed_with_its_arms(small: Learned) -> None:
    region = small[1]
    packed = build.region_data(region)
    np.testing.assert_array_equal(unpacked(packed["x_train"]), region.arrays_.x_train.ravel())
    np.testing.assert_array_equal(unpacked(packed["y_train"]), region.embedding_.ravel())
    assert list(packed["arms"]) == ["as written", "calibrated"]
    for name, arm in build.arms(region).items():
        own, gamma = packed["arms"][name], packed["arms"][name]["gamma"]
        np.testing.assert_array_equal(arm.arrays_.x_train, region.arrays_.x_train)  # packed once
        np.testing.assert_array_equal(unpacked(gamma["grid"]), arm.arrays_.gamma.ravel())
        assert gamma["cell"] == arm.arrays_.cell and gamma["origin"] == arm.arrays_.origin.tolist()
        assert own["neighbours"] == arm.arrays_.neighbours and own["evidence"] == arm.gamma_evidence
        for part, array in arm.arrays_.network._asdict().items() if own["network"] else ():
            np.testing.assert_array_equal(unpacked(own["network"][part]), array.ravel())
    assert packed["arms"]["as written"]["network"] and packed["arms"]["calibrated"]["network"] is None


def test_test_states_carry_their_labels(page: Path, small_config: Config) -> None:
    data = data_of(page)
    for kind in data["test"].values():
        x = unpacked(kind["x"]).reshape(-1, 6).astype(np.float64)
        labels = unpacked(kind["labels"]).reshape(len(build.DELTAS), -1)
        assert labels.shape == (31, 30)
        for place, delta in ((0, 1.0), (5, 1.5), (30, 4.0)):
            assert data["deltas"][place] == delta
            expected = ClosedLoop.from_config(small_config, delta).predict(x)
            np.testing.assert_array_equal(labels[place], expected)
    uniform, visited = (np.abs(unpacked(data["test"][k]["x"])).mean() for k in ("uniform", "random policy"))
    assert uniform > visited


def test_of_each_condition_the_first_seed_is_taken(page: Path, parts: Path) -> None:
    actors = data_of(page)["actors"]
    assert [(a["alpha"], a["delta"], a["seed"]) for a in actors] == [("0.5", 1.5, 0), ("none", 1.5, 0)]


def test_curves_are_means_of_bins(parts: Path) -> None:
    found = build.figure_3(parts)
    curves = pd.read_csv(parts / "fig3_abc_learning.csv")
    own = curves[(curves["delta"] == 1.1) & (curves["alpha"] == "0.5")]
    first = own[own["step"] <= 4]  # 400 steps in 100 bins
    seeds = first.groupby("seed")["mean_return"].mean()
    panel = found["panels"][0]
    assert panel["delta"] == 1.1 and len(panel["curves"]["0.5"]["mean"]) == build.CURVE_POINTS
    assert panel["curves"]["0.5"]["step"][0] == 4
    assert panel["curves"]["0.5"]["mean"][0] == pytest.approx(seeds.mean(), rel=1e-5)
    assert panel["curves"]["0.5"]["low"][0] == pytest.approx(seeds.min(), rel=1e-5)
    assert panel["counts"]["0.5"]["activations"] == {"mean": 100.5, "seeds": [100, 101]}
    assert found["seeds"] == 2


def test_colours_are_those_of_the_house(page: Path) -> None:
    stated = {style.SAFE, style.UNSAFE, style.CORRECTIVE, style.TARGET, *style.CONDITIONS.values()}
    text = page.read_text()
    assert all(colour in text for colour in stated)
    for name in ("page.css", "page.js", "model.js", "page.html"):
        source = re.sub(
            r"#[a-z0-9_]+-?[a-z0-9-]*(?=[\s,.:\[>{]|$)", "", (ROOM / name).read_text()
        )  # ids in CSS
        assert not re.search(r"#[0-9A-Fa-f]{6}\b|#[0-9A-Fa-f]{3}\b", source), name


def test_text_in_data_cannot_end_the_script(parts: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "TEST_STATES", 2)
    data = build.collect(parts, parts) | {"note": "</script><script>alert(1)"}
    assert "</script><script>alert" not in build.render(data)


@pytest.mark.parametrize(
    ("lacking", "words"),
    [("region*", "holds no regions"), ("alpha*", "holds no policies"), ("fig3_def*", "missing result")],
)
def test_without_its_parts_no_page_is_made(
    parts: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], lacking: str, words: str
) -> None:
    folder = shutil.copytree(parts, tmp_path / "parts")
    for path in folder.glob(lacking):
        path.unlink()
    out = tmp_path / "explorer.html"
    line = ["explorer", "--policies", str(folder), "--figures", str(folder), "--out", str(out)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "TEST_STATES", 2)
        assert main(line) == 1
    error = capsys.readouterr().err
    assert words in error and error.count("\n") == 1 and not out.exists()


def test_policies_of_other_values_are_refused(
    parts: Path, small_config: Config, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, out = shutil.copytree(parts, tmp_path / "parts"), tmp_path / "explorer.html"
    save_policy(folder, 1.0, 0, small_config.with_values(p_t=0.7))
    line = ["explorer", "--policies", str(folder), "--figures", str(folder), "--out", str(out)]
    assert main(line) == 1
    assert "p_t = 0.7, not with 0.8" in capsys.readouterr().err
    for path in folder.glob("alpha*"):
        path.unlink()
    save_policy(folder, 0.5, 0, small_config.with_values(psi_neighbours=5))
    with pytest.raises(SystemExit) as stop:
        main(line)
    assert stop.value.code == 2
    assert "psi_neighbours = 5" in capsys.readouterr().err and not out.exists()
    for path in folder.glob("alpha*"):
        path.unlink()
    save_policy(folder, 0.5, 0, small_config.with_values(gamma_weights="density ratio"))
    with pytest.raises(SystemExit):
        main(line)
    assert "gamma_weights = density ratio" in capsys.readouterr().err and not out.exists()
