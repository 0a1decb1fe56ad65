"""The workflow on a real Slurm of one node: the same tables as here, even where it loses the node."""

import time
from importlib.util import find_spec
from pathlib import Path

import pytest
from checkouts import copy_sources, start, tables
from cluster import Cluster, missing

GRID = ["--alphas", "0", "none", "--deltas", "1.1", "--seeds", "1", "--steps", "2048"]
GRID += ["--set", "k=200", "random_rollouts=200"]
LIMIT = 7200.0  # s for the grid; a machine that has nothing else to do takes minutes

needs_slurm = pytest.mark.skipif(
    bool(missing()),
    reason=f"no {', '.join(missing())}: tests/slurm/run.sh installs Slurm and runs these tests",
)
needs_plugin = pytest.mark.skipif(
    find_spec("snakemake_executor_plugin_slurm") is None,
    reason="no plugin of Snakemake for Slurm: tests/slurm/run.sh installs it and runs these tests",
)


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A copy of the sources."""
    return copy_sources(tmp_path)


@needs_slurm
@pytest.mark.slow
def test_the_cluster_runs_jobs(tmp_path: Path) -> None:
    with Cluster(tmp_path) as cluster:
        assert cluster.ask("srun", "-n1", "echo", "works") == "works"


@needs_slurm
@pytest.mark.slurm
@pytest.mark.slow
def test_the_cluster_survives_its_node(tmp_path: Path) -> None:
    with Cluster(tmp_path) as cluster:
        job = cluster.ask("sbatch", "--parsable", "--requeue", "--output=/dev/null", "--wrap", "sleep 1000")
        cluster.until_running(job)
        cluster.lose_node()
        cluster.bring_node()
        cluster.until_running(job)  # again
        assert "Restarts=1" in cluster.ask("scontrol", "show", "job", job)


@needs_slurm
@needs_plugin
@pytest.mark.slurm
@pytest.mark.slow
def test_the_grid_has_the_same_tables_though_its_node_is_lost(
    checkout: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    assert start(checkout, "--name", "here", "--cores", "2", *GRID).wait(LIMIT) == 0
    with Cluster(tmp_path_factory.mktemp("slurm")) as cluster:
        driver = start(checkout, "--name", "there", "--slurm", *GRID, environment=cluster.environment)
        try:
            data = checkout / "results" / "there" / "data_0" / "alpha_0" / "training_data.npz"
            while not data.exists() and driver.poll() is None:  # the first result: others are under way
                time.sleep(0.2)
            running = cluster.ask("squeue", "-h", "-t", "RUNNING", "-o", "%A").split()
            cluster.lose_node()
            cluster.bring_node()
            queued = [cluster.ask("scontrol", "show", "job", job) for job in running]
            assert running and all("Restarts=1" in job for job in queued)
            assert driver.wait(LIMIT) == 0
        finally:
            driver.terminate()
            driver.wait(LIMIT)
    here, there = tables(checkout, "here"), tables(checkout, "there")
    assert here.keys() == there.keys() and len(here) > 10
    assert [name for name in here if here[name] != there[name]] == []
