"""What made a result: code, versions, machine, time, memory."""

import hashlib
import os
import platform
import resource
import sys
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

PACKAGES = (
    "numpy",
    "scipy",
    "numba",
    "scikit-learn",
    "openTSNE",
    "gymnasium",
    "stable-baselines3",
    "torch",
    "pandas",
    "matplotlib",
)

MADE_BY = "SRLREPRO_MADE_BY"  # variable in which an executed notebook is told what makes its figures (JSON)
PACKAGE = Path(__file__).resolve().parents[1]


@cache
def code_hash() -> str:
    """SHA-256 of the sources of the method: paths and contents."""
    digest = hashlib.sha256()
    for source in sorted(PACKAGE.rglob("*.py")):
        digest.update(source.relative_to(PACKAGE).as_posix().encode() + b"\0" + source.read_bytes() + b"\0")
    return digest.hexdigest()


def processor() -> str:
    """The processor's model name."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def peak_memory(who: int = resource.RUSAGE_SELF) -> float:
    """Largest memory that this process (or with RUSAGE_CHILDREN, one that it ended) has used so far, MB."""
    unit = 1 if sys.platform == "darwin" else 1024  # bytes in which ru_maxrss counts
    return resource.getrusage(who).ru_maxrss * unit / 1e6


def provenance(seconds: float, who: int = resource.RUSAGE_SELF, code: str = "") -> dict[str, Any]:
    """What made a result: hash of its code (by default the method's), versions, machine, s, memory (MB)."""
    return {
        "code": code or code_hash(),
        "python": platform.python_version(),
        "versions": {name: version(name) for name in PACKAGES},
        "machine": {"system": platform.system(), "processor": processor(), "cores": os.cpu_count()},
        "seconds": round(seconds, 1),
        "peak_memory_mb": round(peak_memory(who)),
    }
