"""What rounding alone does to means of three seeds: the same grid from two learners.

Both sets of results stand in the history: a faster gradient step changed the order of sums between them, and
no parameter. That measures of data and regions agree exactly is checked; those of runs are compared.
"""

import io
import subprocess
from pathlib import Path

import pandas as pd

from srlrepro.storage.files import write_table

ROOT = Path(__file__).parent.parent
OUT = ROOT / "docs" / "records" / "rounding.csv"
BEFORE, AFTER = "38c440055f", "f1fb93fb04"  # commits of the grid before and after the change
COMPARED = ("final_return", "policy_return_share", "success_rate")
CELL = ["measure", "alpha", "delta"]


def kept(commit: str) -> pd.DataFrame:
    """The measures that a commit holds.

    Raises:
        CalledProcessError: the history does not reach it.
    """
    command = ["git", "show", f"{commit}:figures/full/measures.csv"]
    text = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return pd.read_csv(io.StringIO(text), dtype={"alpha": str})


def compare(before: pd.DataFrame, after: pd.DataFrame) -> pd.DataFrame:
    """Means over seeds of runs, before and after: measure, alpha, delta, before, after.

    Raises:
        ValueError: measures of the data or the regions differ, so that more than rounding has changed.
    """
    both = before.merge(after, on=[*CELL, "seed"], suffixes=("_before", "_after"))
    data = both[both["delta"].isna()]
    if not data["value_before"].equals(data["value_after"]):
        raise ValueError("the training data or the regions differ")
    runs = both[both["measure"].isin(COMPARED)]
    means = runs.groupby(CELL)[["value_before", "value_after"]].mean().reset_index()
    return means.rename(columns={"value_before": "before", "value_after": "after"})


if __name__ == "__main__":
    write_table(OUT, compare(kept(BEFORE), kept(AFTER)), digits=5)
