"""What the workflow takes: minutes over all its sittings, core hours and memory of its trainings."""

import os
from pathlib import Path
from typing import Any

from srlrepro.files import read_json, write_json
from srlrepro.provenance import processor


def machine() -> dict[str, Any]:
    """Where a time was measured."""
    return {"processor": processor(), "processor_cores": os.cpu_count()}


def add_time(file: Path, minutes: float, **run: Any) -> dict[str, Any]:
    """Keep, in a file beside results, the time that they took over all sittings in which a job was done."""
    before = read_json(file) if file.exists() else {"minutes": 0.0, "sittings": 0}
    timing = {"minutes": round(before["minutes"] + minutes, 1), "sittings": before["sittings"] + 1}
    timing |= run | machine()
    write_json(file, timing)
    return timing


def spent(folder: Path, seeds: list[int] | None = None) -> dict[str, Any]:
    """What the finished trainings (of some seeds) below a folder took: number, core hours, largest memory."""
    found = [read_json(path) for path in folder.rglob("run.json")]
    costs = [result["provenance"] for result in found if seeds is None or result["run"]["seed"] in seeds]
    return {
        "trainings": len(costs),
        "core_hours": round(sum(cost["seconds"] for cost in costs) / 3600, 2),
        "peak_memory_mb": max((cost["peak_memory_mb"] for cost in costs), default=0),
    }
