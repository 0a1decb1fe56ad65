"""What made a result: code, versions, machine, time, memory."""

import hashlib
import os
import platform
import resource
import sys
from collections.abc import Iterable
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

# The modules on which the numbers of each stage depend, beside the values of the configuration.
PHYSICS = ("pendulum", "lqg", "labels")
DATA = (*PHYSICS, "sampling")
REGION = (*DATA, "embedding", "assessment", "judging", "safe_region")
TASK = (*REGION, "env", "supervisor", "hypotheses")
LEARNER = ("network", "updating", "rollout", "sharing", "replay", "compiled_ppo")
LEARNING = (*TASK, *LEARNER, "checkpoint", "recording", "training")
EVERYTHING = tuple(sorted(path.stem for path in Path(__file__).parent.glob("*.py")))


@cache
def code_hash(modules: Iterable[str] = LEARNING) -> str:
    """SHA-256 of the sources of modules of the package."""
    digest = hashlib.sha256()
    for name in sorted(modules):
        source = Path(__file__).parent / f"{name}.py"
        digest.update(source.name.encode() + b"\0" + source.read_bytes() + b"\0")
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


def provenance(
    seconds: float, modules: tuple[str, ...] = LEARNING, who: int = resource.RUSAGE_SELF
) -> dict[str, Any]:
    """Hash of the code of a result, versions, machine, the time that the result took (s), memory (MB)."""
    return {
        "code": code_hash(modules),
        "python": platform.python_version(),
        "versions": {name: version(name) for name in PACKAGES},
        "machine": {"system": platform.system(), "processor": processor(), "cores": os.cpu_count()},
        "seconds": round(seconds, 1),
        "peak_memory_mb": round(peak_memory(who)),
    }
