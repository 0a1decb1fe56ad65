"""SHA-256 of the tables and pages in a folder, beside them, so that no digit of one changes unseen.

The list is in sha256sum's own format: ``sha256sum --check sha256.txt`` in the folder reads it as well.
"""

from pathlib import Path

from srlrepro.storage.files import beside, existing, sha256

DIGESTS = "sha256.txt"
SET = "workflow.json"  # in a folder of figures: the configuration of the workflow that made the set
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
