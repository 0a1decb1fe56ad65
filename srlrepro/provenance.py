"""What made a result: code, versions, machine, time."""

import hashlib
import os
import platform
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


@cache
def code_hash() -> str:
    """SHA-256 of the package's sources, in the order of their names."""
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.name.encode() + b"\0" + source.read_bytes() + b"\0")
    return digest.hexdigest()


def processor() -> str:
    """The processor's model name."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def provenance(seconds: float) -> dict[str, Any]:
    """Code hash, versions, machine, and the time that the result took (s)."""
    return {
        "code": code_hash(),
        "python": platform.python_version(),
        "versions": {name: version(name) for name in PACKAGES},
        "machine": {"system": platform.system(), "processor": processor(), "cores": os.cpu_count()},
        "seconds": round(seconds, 1),
    }
