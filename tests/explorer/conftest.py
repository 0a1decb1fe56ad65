"""A page of few states, made by the command."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from learned import Learned
from stored import STEPS, save_policy

from replication.__main__ import main
from replication.explorer import build
from srlrepro.settings.config import Config


@pytest.fixture(scope="session")
def parts(small: Learned, small_config: Config, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a region, policies of two conditions (two seeds of one), and the tables of Fig. 3."""
    folder = tmp_path_factory.mktemp("parts")
    small[1].save(folder / "region__alpha_0.5__data_0.npz")
    for alpha, seed in ((0.5, 0), (0.5, 1), (None, 0)):
        save_policy(folder, alpha, seed, small_config)
    rng = np.random.default_rng(0)
    cells = [(alpha, delta, seed) for delta in (1.1, 1.5) for alpha in ("0.5", "none") for seed in (0, 1)]
    curves = [(*c, s, 3, s - 200 + rng.normal()) for c in cells for s in range(1, STEPS + 1)]
    columns = ["alpha", "delta", "seed", "step", "trials", "mean_return"]
    pd.DataFrame(curves, columns=columns).to_csv(folder / "fig3_abc_learning.csv", index=False)
    counts = pd.DataFrame([(*c, 100 + i, i, 2 * i) for i, c in enumerate(cells)])
    counts.columns = ["alpha", "delta", "seed", "activations", "failures", "falls"]
    counts.to_csv(folder / "fig3_def_counts.csv", index=False)
    return folder


@pytest.fixture(scope="session")
def page(parts: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of `parts`."""
    out = tmp_path_factory.mktemp("page") / "explorer.html"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "TEST_STATES", 30)
        line = ["explorer", "--policies", str(parts), "--figures", str(parts), "--out", str(out)]
        assert main(line) == 0
    return out
