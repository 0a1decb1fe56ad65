"""SHA-256 of the tables and pages in a folder, beside them, so that no digit of one changes unseen.

The list is in sha256sum's own format: ``sha256sum --check sha256.txt`` in the folder reads it as well.
"""

from pathlib import Path
from typing import Any

from srlrepro.storage.files import ResultError, beside, existing, read_json, sha256

DIGESTS = "sha256.txt"
SET = "workflow.json"  # in a folder of figures: the configuration of the workflow that made the set
KINDS = {"arithmetic": int, "steps": int, "study": str}  # of entries of SET that decide how a set is read
WITH_DIGESTS = ("*.csv", "*.md", "api/*.md", SET, "records.json", "records/*")


def digests(folder: Path) -> dict[str, str]:
    """{name: SHA-256} of the tables, pages and records in a folder, by name."""
    files = {path for pattern in WITH_DIGESTS for path in folder.glob(pattern)}
    return {path.relative_to(folder).as_posix(): sha256(path) for path in sorted(files)}


def write_digests(folder: Path) -> None:
    """Write `digests` beside the tables, as sha256sum does."""
    with beside(folder / DIGESTS) as temporary:
        temporary.write_text("".join(f"{digest}  {name}\n" for name, digest in digests(folder).items()))


def changed(folder: Path) -> list[str]:
    """The names in a folder whose digest is not the one beside them, or that stand on one side alone."""
    lines = existing(folder / DIGESTS).read_text(encoding="utf-8", errors="replace").splitlines()
    kept = {name: digest for digest, _, name in (line.partition("  ") for line in lines)}
    found = digests(folder)
    return sorted(name for name in kept.keys() | found.keys() if kept.get(name) != found.get(name))


def read_set(file: Path) -> dict[str, Any]:
    """The configuration of the workflow behind a set of results; `ResultError`: the file holds none."""
    found: Any = read_json(file)
    if not (
        isinstance(found, dict) and all(_fits(found[name], KINDS[name]) for name in KINDS if name in found)
    ):
        raise ResultError(f"{file} is no configuration of the workflow")
    return found


def _fits(value: Any, kind: type) -> bool:
    return isinstance(value, kind) and not isinstance(value, bool)
