"""The compiler: numba, with code that is kept on disk until a source of compiled code changes.

Nothing here lets the compiler reorder a sum or fuse a product with it. So the loops have the bits of the
order in which they are written, whatever the width of the processor's vectors.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba import njit

# numba does not notice when a compiled function calls one that has changed in another file, so compiled
# code is kept apart by the sources of everything that is compiled.
_package = Path(__file__).resolve().parents[1]
_texts = (path.read_bytes() for path in sorted(_package.rglob("*.py")))
_marks = b"@jit", b"@inner", b"@intrinsic"
_sources = b"".join(text for text in _texts if any(mark in text for mark in _marks))
_kept = Path(os.environ.get("NUMBA_CACHE_DIR") or _package / "__pycache__")
_name = f"numba-{hashlib.sha256(_sources).hexdigest()[:12]}"
numba.config.CACHE_DIR = str(_kept / _name)  # type: ignore[attr-defined]

Function = TypeVar("Function", bound=Callable[..., Any])

# What numba's own type hints leave out. Nothing takes the address of a kernel as a C function's.
_OPTIONS: dict[str, Any] = {"cache": True, "error_model": "numpy", "no_cfunc_wrapper": True}
_INNER = _OPTIONS | {"no_cpython_wrapper": True}


def jit(function: Function) -> Function:
    """Compile with numba, cached on disk; a division by zero gives infinity, so that loops vectorise."""
    return cast(Function, njit(function, **_OPTIONS))


def inner(function: Function) -> Function:
    """`jit` for a kernel that only compiled code calls: without the wrapper by which Python would call it.

    The wrapper unpacks every array of a tuple of tuples. It takes longer to compile than most kernels.
    Without it numba would jump to nowhere when Python calls the kernel; here Python runs the function itself.
    """
    kernel = njit(function, **_INNER)

    def keep(compiled: Any) -> None:
        kernel.overloads[tuple(compiled.signature.args)] = compiled  # but not where calls from Python look

    kernel.add_overload, kernel._compile_for_args = keep, lambda *arguments, **named: function
    return cast(Function, kernel)
