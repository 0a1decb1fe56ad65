"""What the workflow took: summed over sittings and trainings."""

import json
from pathlib import Path

from workflow import costs


def test_the_time_of_results_is_that_of_all_sittings(tmp_path: Path) -> None:
    file = tmp_path / "run_time.json"
    for minutes, total, sittings in ((2.0, 2.0, 1), (0.5, 2.5, 2)):
        timing = costs.add_time(file, minutes, cores=2)
        assert timing == json.loads(file.read_text())
        assert (timing["minutes"], timing["sittings"], timing["cores"]) == (total, sittings, 2)


def test_what_trainings_took_is_summed_over_the_seeds_asked_for(tmp_path: Path) -> None:
    for seed, seconds in enumerate((1800, 3600, 7200)):
        (tmp_path / f"run_{seed}").mkdir()
        result = {"run": {"seed": seed}, "provenance": {"seconds": seconds, "peak_memory_mb": 500 + seed}}
        (tmp_path / f"run_{seed}" / "run.json").write_text(json.dumps(result))
    assert costs.spent(tmp_path, [0, 1]) == {"trainings": 2, "core_hours": 1.5, "peak_memory_mb": 501}
    assert costs.spent(tmp_path)["trainings"] == 3
    assert costs.spent(tmp_path / "nowhere", [0])["trainings"] == 0
