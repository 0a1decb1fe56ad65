"""A small grid whose tables have the same bytes on every processor (docs/same_bytes.md), and their SHA-256.

``python -m benchmarks.same_bytes`` makes it and compares it with the digests that are kept (`GOLDEN`). Each
grid is made by a process of its own, under the pins. The families are those of other processors, as far as
this one can emulate them: numba compiles for another processor, OpenBLAS takes another's kernels.
"""

import hashlib
import json
import os
import platform
import subprocess
import sys
import tempfile
from datetime import UTC, datetime
from pathlib import Path

from srlrepro.command_line import Parser
from srlrepro.pins import ARITHMETIC, CPUINFO, pins

ROOT = Path(__file__).parent.parent
GOLDEN = ROOT / "tests" / "golden" / "sha256.json"
PROCESSORS = ROOT / "docs" / "records" / "processors.csv"
DELTA, SEED, STEPS = 1.5, 0, 6144  # three updates: enough for every kernel, and for most trials to end
FEWER = {"k": 200, "random_rollouts": 200}  # for seconds instead of minutes
AVX2 = "+avx,+avx2,+fma,+f16c,+bmi,+bmi2,+lzcnt,+popcnt,+movbe,+sse4.2,+cx16"
AVX512 = "+avx512f,+avx512bw,+avx512cd,+avx512dq,+avx512vl"
NO_AVX512 = AVX512.replace("+", "-")
FAMILIES = {  # the name alone would leave numba the vector width of this processor
    "host": {},
    "haswell": {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": f"{AVX2},{NO_AVX512}"},
    "znver2": {
        "NUMBA_CPU_NAME": "znver2",
        "NUMBA_CPU_FEATURES": f"{AVX2},{NO_AVX512}",
        "OPENBLAS_CORETYPE": "Zen",
    },
    "skylake-avx512": {"NUMBA_CPU_NAME": "skylake-avx512", "NUMBA_CPU_FEATURES": f"{AVX2},{AVX512}"},
}
LONG = "long"  # the grid of one run of full length, which takes minutes


def emulated() -> list[str]:
    """The families whose instructions this processor has."""
    wide = "avx512vl" in (CPUINFO.read_text(encoding="utf-8") if CPUINFO.exists() else "")
    return [name for name, values in FAMILIES.items() if wide or AVX512 not in str(values)]


def digest(*arrays: object) -> str:
    """SHA-256 of the bytes of arrays, one after the other."""
    import numpy as np

    return hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()


def make(folder: Path, long: bool = False) -> dict[str, str]:
    """{table: SHA-256} of a grid that is made in a folder, in this process.

    Of data and regions the digests are those of their arrays, of runs those of the tables, visited states and
    parameters of the final policy; archives hold the time at which they were written.
    """
    from replication.evidence.measures import measure_run, write_measures
    from replication.evidence.results import TrainedRun, read_run
    from srlrepro.dynamics.lqg import LQG
    from srlrepro.learner.policy import load_policy
    from srlrepro.learner.training import Run, train
    from srlrepro.region.safe_region import learn_region
    from srlrepro.samplers import generate
    from srlrepro.settings.config import Config

    config = Config() if long else Config().with_values(**FEWER)
    gains = LQG()
    found = {"lqg": digest(gains.gain, gains.filter_gain)}
    free: TrainedRun | None = None
    for alpha in (0.5,) if long else (None, 0.0, 0.5, 1.0):
        run, region = Run(alpha, DELTA, SEED, config.choices.total_steps if long else STEPS), None
        if alpha is not None:
            data = generate(alpha, config, SEED)
            region = learn_region(data, config, SEED)
            found[f"data {run.alpha_text}"] = digest(data.x, data.z)
            found[f"region {run.alpha_text}"] = digest(region.transform(data.x), region.safety(data.x))
        train(run, config, region, place := folder / run.name, report=lambda _: None)
        trained = read_run(place)
        write_measures(place / "measures.csv", measure_run(trained, region, free))
        free = trained if alpha is None else free
        for table in ("trials", "curve", "measures"):
            content = (place / f"{table}.csv").read_bytes()
            found[f"{table} {run.alpha_text}"] = hashlib.sha256(content).hexdigest()
        found[f"visited {run.alpha_text}"] = digest(trained.visited())
        policy = load_policy(place / "policy.npz")
        found[f"policy {run.alpha_text}"] = digest(*policy.weights, *policy.biases, policy.log_std)
    return found


def grid(family: str = "host", long: bool = False, **variables: str) -> dict[str, str]:
    """`make` in a process of its own, under the pins, those of a family and further variables.

    Raises:
        CalledProcessError: it failed; its message stands on standard error.
    """
    environment = os.environ | pins() | FAMILIES[family] | variables
    environment["PYTHONWARNINGS"] = "ignore"  # that a family has another pin
    command = [sys.executable, "-m", "benchmarks.same_bytes", "--child", *([f"--{LONG}"] if long else [])]
    done = subprocess.run(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, check=True)
    found: dict[str, str] = json.loads(done.stdout)
    return found


def kept(long: bool = False) -> dict[str, str] | None:
    """The digests that are kept; None if there are none of this arithmetic."""
    held = json.loads(GOLDEN.read_text(encoding="utf-8")) if GOLDEN.exists() else {}
    tables: dict[str, str] | None = held.get(LONG if long else "small")
    return tables if held.get("arithmetic") == ARITHMETIC else None


def differing(found: dict[str, str], wanted: dict[str, str]) -> list[str]:
    """The tables whose digests differ, or that only one of the grids has."""
    return [name for name in sorted(found.keys() | wanted.keys()) if found.get(name) != wanted.get(name)]


def note(found: dict[str, str], result: str) -> None:
    """Note in `PROCESSORS` what was found on this one; what stands there already is not noted twice."""
    import pandas as pd

    from srlrepro.storage.files import write_table
    from srlrepro.storage.provenance import processor

    whole = hashlib.sha256(json.dumps(found, sort_keys=True).encode()).hexdigest()
    row = {"processor": processor(), "date": datetime.now(UTC).date().isoformat()}
    row |= {"glibc": " ".join(platform.libc_ver()), "arithmetic": str(ARITHMETIC)}
    row |= {"sha256": whole[:16], "result": result}
    before = pd.read_csv(PROCESSORS, dtype=str) if PROCESSORS.exists() else pd.DataFrame(columns=[*row])
    write_table(PROCESSORS, pd.concat([before, pd.DataFrame([row])]).drop_duplicates())


def main(argv: list[str] | None = None) -> int:
    """The command line; returns the exit status, 1 where a table differs."""
    parser = Parser(prog="python -m benchmarks.same_bytes", description=__doc__, allow_abbrev=False)
    parser.add_argument("--families", nargs="*", choices=emulated(), help="those to emulate (default: none)")
    parser.add_argument(f"--{LONG}", action="store_true", help="one run of full length instead (minutes)")
    parser.add_argument(
        "--write", action="store_true", help="keep the digests instead of comparing with them"
    )
    parser.add_argument("--record", action="store_true", help=f"note it in {PROCESSORS.relative_to(ROOT)}")
    parser.add_argument("--child", action="store_true", help="make the grid here and print it (JSON)")
    arguments = parser.parse_args(argv)
    if arguments.child:
        with tempfile.TemporaryDirectory() as place:
            print(json.dumps(make(Path(place), arguments.long)))
        return 0
    from srlrepro.storage.files import write_json

    wanted = kept(arguments.long)
    if wanted is None and not arguments.write:
        parser.error(
            f"{GOLDEN.relative_to(ROOT)} keeps no digests of arithmetic {ARITHMETIC}: --write makes them"
        )
    found = grid("host", arguments.long)
    if arguments.write:
        before = json.loads(GOLDEN.read_text(encoding="utf-8")) if GOLDEN.exists() else {}
        same = before if before.get("arithmetic") == ARITHMETIC else {"arithmetic": ARITHMETIC}
        write_json(GOLDEN, same | {LONG if arguments.long else "small": found})
        wanted = found
    assert wanted is not None
    failed = {"host": differing(found, wanted)}
    for family in arguments.families or []:
        failed[family] = differing(grid(family, arguments.long), wanted)
    for family, tables in failed.items():
        said = f"{len(tables)} of {len(wanted)} tables differ: {', '.join(tables)}" if tables else "same"
        print(f"{family}: {said}")
    held = not any(failed.values())
    if arguments.record:
        note(found, f"{LONG if arguments.long else 'small'} grid {'same' if held else 'differs'}")
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
