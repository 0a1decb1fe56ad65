"""Each pin is seen to act, in a process of its own; and what happens with, without and against them."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from srlrepro import pins
from srlrepro.pins import KERNELS, THREADS

ROOT = Path(__file__).parent.parent
NAMES = [*KERNELS, *THREADS]
BARE = {name: value for name, value in os.environ.items() if name not in NAMES}
COVERED = pytest.mark.skipif(not pins.is_covered(), reason="not an x86-64 processor with AVX2 and FMA")
# What the libraries say of themselves, and digests of what they compute.
ASK = """
import hashlib, json
import numpy as np
import scipy.linalg
import threadpoolctl
import torch
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

def digest(*arrays):
    return hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()

rng = np.random.default_rng(0)
single = rng.normal(size=(128, 128)).astype(np.float32)
pools = threadpoolctl.threadpool_info()
torch.manual_seed(0)
drawn = torch.nn.init.orthogonal_(torch.empty(64, 64)).numpy()
print(json.dumps({
    "openblas": [p["architecture"] for p in pools if p["internal_api"] == "openblas"],
    "threads": [p["num_threads"] for p in pools],
    "dispatched": [name for name in __cpu_dispatch__ if __cpu_features__[name]],
    "torch": torch.backends.cpu.get_cpu_capability(),
    "OPENBLAS_CORETYPE": digest(single @ single.T, scipy.linalg.qr(single)[0]),
    "NPY_DISABLE_CPU_FEATURES": digest(np.exp(rng.normal(size=4096))),
    "MKL_CBWR": digest(torch.from_numpy(single) @ torch.from_numpy(single), drawn),
}))
"""


def asked(code: str = ASK, **variables: str) -> dict[str, object]:
    """What a process prints as JSON that has these variables and none of the pins else."""
    done = subprocess.run(
        [sys.executable, "-c", code], env=BARE | variables, cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    found: dict[str, object] = json.loads(done.stdout)
    return found


@pytest.fixture(scope="module")
def free() -> dict[str, object]:
    return asked(**THREADS)


@pytest.fixture(scope="module")
def pinned() -> dict[str, object]:
    return asked(**pins.pins())


@COVERED
def test_the_libraries_say_that_they_are_pinned(pinned: dict[str, object]) -> None:
    assert pinned["openblas"] == ["Haswell", "Haswell"]  # numpy's and scipy's
    assert pinned["dispatched"] == ["X86_V3"] and pinned["torch"] == "AVX2"
    assert set(pinned["threads"]) == {1}  # type: ignore[call-overload]


def test_this_process_is_pinned_before_numpy_was_loaded() -> None:
    import torch
    from numpy._core._multiarray_umath import __cpu_features__

    assert pins.unpinned() == []
    assert not pins.is_covered() or not any(
        __cpu_features__[name] for name in KERNELS["NPY_DISABLE_CPU_FEATURES"].split()
    )
    assert torch.backends.cpu.get_cpu_capability() != "AVX512"


@COVERED
@pytest.mark.parametrize("name", ["OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES", "MKL_CBWR"])
def test_a_pin_changes_bits_where_the_processor_has_more(
    name: str, free: dict[str, object], pinned: dict[str, object]
) -> None:
    if "X86_V4" not in free["dispatched"]:  # type: ignore[operator]
        # What is left without the pin is then what the pin asks for: there is no difference to be seen.
        pytest.skip("the processor has no AVX-512")
    alone = asked(**THREADS, **{name: KERNELS[name]})
    assert alone[name] == pinned[name] != free[name]


@COVERED
def test_cores_of_two_makers_agree_once_pinned_to_what_both_have(pinned: dict[str, object]) -> None:
    assert (
        asked(**pins.pins() | {"OPENBLAS_CORETYPE": "Zen"})["OPENBLAS_CORETYPE"]
        == pinned["OPENBLAS_CORETYPE"]
    )


def test_all_that_numpy_has_beyond_avx2_is_named() -> None:
    from numpy._core._multiarray_umath import __cpu_dispatch__

    known = {"X86_V2", "X86_V3"}  # up to AVX2 and FMA
    assert {*__cpu_dispatch__} - known == set(KERNELS["NPY_DISABLE_CPU_FEATURES"].split())


def test_numpy_starts_where_it_does_not_know_a_name() -> None:
    """As other builds of numpy do not know ours: no error, and no warning that Python shows."""
    names = KERNELS["NPY_DISABLE_CPU_FEATURES"] + " NAME_OF_ANOTHER_BUILD"
    code = "import numpy\nprint(numpy.arange(3).sum())"
    assert asked(code, NPY_DISABLE_CPU_FEATURES=names) == 3


def test_only_threads_are_pinned_where_the_kernels_cannot_run(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pins.is_covered.cache_clear()
    monkeypatch.setattr(pins, "CPUINFO", tmp_path / "cpuinfo")
    (tmp_path / "cpuinfo").write_text("model name : old\nflags : sse2 avx fma\n")
    assert pins.pins() == THREADS
    pins.is_covered.cache_clear()
    (tmp_path / "cpuinfo").write_text("model name : new\nflags : sse2 avx2 fma\n")
    monkeypatch.setattr(pins.platform, "machine", lambda: "x86_64")
    assert pins.pins() == THREADS | KERNELS
    pins.is_covered.cache_clear()
    monkeypatch.setattr(pins.platform, "machine", lambda: "aarch64")
    assert pins.pins() == THREADS
    monkeypatch.undo()
    pins.is_covered.cache_clear()


def run(code: str, **variables: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code], env=BARE | variables, cwd=ROOT, capture_output=True, text=True
    )


def test_pin_comes_before_numpy_or_says_that_it_is_late() -> None:
    code = "import srlrepro.pins as p\np.pin()\nimport numpy\np.pin()\nassert p.unpinned() == []"
    done = run(code)
    assert (done.returncode, done.stderr) == (0, "")
    late = run("import numpy, srlrepro.pins as p\np.pin()")
    assert late.returncode == 1 and "call srlrepro.pins.pin() first" in late.stderr.splitlines()[-1]


def test_the_package_changes_no_variable_of_its_user() -> None:
    code = "import os\nbefore = dict(os.environ)\nimport srlrepro.samplers\nassert dict(os.environ) == before"
    assert run(code).returncode == 0


@pytest.mark.parametrize(
    "module", ["srlrepro.samplers", "srlrepro.fast_ppo.ppo", "srlrepro.learner.training"]
)
def test_who_computes_without_pins_is_warned_once(module: str) -> None:
    code = f"import {module}\nfrom srlrepro import LQG, pins\npins.warn()"
    done = run(code)
    assert done.returncode == 0 and done.stderr.count("UnpinnedWarning") == 1
    assert "OMP_NUM_THREADS" in done.stderr and "pins.pin()" in done.stderr
    assert run(code, **pins.pins()).stderr == ""


@pytest.mark.parametrize("house", ["srlrepro", "replication", "workflow"])
def test_a_command_line_pins_itself_and_says_what_it_replaces(house: str) -> None:
    command = [sys.executable, "-m", house, "--help"]
    quiet = subprocess.run(command, env=BARE, cwd=ROOT, capture_output=True, text=True)
    assert (quiet.returncode, quiet.stderr) == (0, "")
    own = subprocess.run(
        command, env=BARE | {"OMP_NUM_THREADS": "7"}, cwd=ROOT, capture_output=True, text=True
    )
    assert own.stderr == f"python -m {house}: takes its own pins instead of OMP_NUM_THREADS=7\n"


def test_a_command_computes_under_the_pins() -> None:
    """Seen in what numpy says in the process of a command, which the user started without any pin."""
    code = "import runpy, sys\nsys.argv = ['', '--help']\n"
    code += "try: runpy.run_module('replication', run_name='__main__')\nexcept SystemExit: pass\n"
    code += "from numpy._core._multiarray_umath import __cpu_features__ as f\nimport os\n"
    code += "print(f['X86_V4'], os.environ['OMP_NUM_THREADS'])"
    assert run(code).stdout.splitlines()[-1] == "False 1"
