"""The pins of the numerical libraries: the same bits on every x86-64 processor with AVX2 and FMA.

The libraries choose their kernels by the processor, and kernels of another vector width sum in another order.
What is pinned here takes the kernels that all these processors have. The libraries read the variables as they
are loaded, so that `pin` must come before numpy; this module needs the standard library alone.
docs/same_bytes.md says what follows from it, and what is not covered.
"""

import os
import platform
import sys
import warnings
from functools import cache
from pathlib import Path

# The number of the arithmetic that results rest on: the order of sums, the compiled kernels, the pins. It is
# raised by hand when a change of one of these changes bits; results of another number are made again.
ARITHMETIC = 1
NEEDED = frozenset({"avx2", "fma"})  # instructions of a processor on which the promise holds
KERNELS = {
    # Its kernels for AVX-512 sum products in another order than those for AVX2, which agree with each other.
    "OPENBLAS_CORETYPE": "Haswell",
    # numpy's names of all it has beyond AVX2 and FMA: its exp and log differ there. It passes over what the
    # processor lacks, and a build that does not know a name gives an ImportWarning, which Python hides.
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    # torch's own vectorised loops. Its float32 products are MKL's: oneDNN computes none of ours.
    "ATEN_CPU_CAPABILITY": "avx2",
    # MKL takes any other value for AUTO on processors that are not Intel's, and says nothing.
    "MKL_CBWR": "COMPATIBLE",
}
# Sums over parts depend on the number of the parts; and two processes of one thread beat one of two here.
THREADS = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
CPUINFO = Path("/proc/cpuinfo")


class UnpinnedWarning(UserWarning):
    """Results of this process may differ in their last bits from those of another processor."""


@cache
def is_covered() -> bool:
    """Whether this processor is one on which the kernels of the pins run: x86-64 with AVX2 and FMA."""
    if platform.machine() not in ("x86_64", "AMD64") or not CPUINFO.exists():
        return False
    flags = (line.partition(":")[2] for line in CPUINFO.read_text().splitlines() if line.startswith("flags"))
    return set(next(flags, "").split()) >= NEEDED


def pins() -> dict[str, str]:
    """{variable: value} of what is pinned here; of the threads alone where the kernels cannot run."""
    return THREADS | (KERNELS if is_covered() else {})


def unpinned() -> list[str]:
    """The variables that this process has not, or with another value."""
    return [name for name, value in pins().items() if os.environ.get(name) != value]


def pin(program: str = "") -> None:
    """Set the pins in ``os.environ``, for this process and those that it starts.

    Args:
        program: name of a command line. One line on standard error then says what the user had set otherwise.

    Raises:
        RuntimeError: it comes too late, since numpy has been loaded without them.
    """
    lacking = unpinned()
    if lacking and "numpy" in sys.modules:
        raise RuntimeError(f"{lacking[0]} must be set before numpy is loaded: call srlrepro.pins.pin() first")
    replaced = [f"{name}={os.environ[name]}" for name in lacking if name in os.environ]
    os.environ.update(pins())
    if replaced and program:
        print(f"{program}: takes its own pins instead of {', '.join(replaced)}", file=sys.stderr)


@cache
def warn() -> None:
    """Warn, once in a process, if it computes without the pins."""
    lacking, reason = unpinned(), ""
    if lacking:
        reason = f"{', '.join(lacking)} not pinned; call srlrepro.pins.pin() before numpy is loaded"
    elif not is_covered():
        reason = f"this one has not all of {', '.join(sorted(NEEDED))}"
    if reason:
        text = f"last bits may differ from those of other processors: {reason}"
        warnings.warn(text, UnpinnedWarning, stacklevel=2)
