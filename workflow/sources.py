"""What a notebook or a module is made of: the files of the project that it imports, directly or not.

The rules of the workflow name these files as their inputs, so that no list of modules is kept by hand. The
files are read, not run: the import statements anywhere in a file count, those within functions too.
"""

import ast
import hashlib
from functools import cache
from pathlib import Path

from srlrepro import PUBLIC
from srlrepro.storage.files import read_json
from workflow import ROOT

HOUSES = ("srlrepro", "replication", "workflow")
# It holds values and the reasons for them alone. A rule has the values among its parameters, so that a
# reason in better words trains nothing.
WITHOUT = ("srlrepro/settings/choices.py",)


def _imported(code: str) -> set[str]:
    """Dotted names that a text of Python imports: ``from a.b import c`` gives a, a.b and a.b.c."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            lazy = (
                {PUBLIC.get(alias.name, "") for alias in node.names} if node.module == "srlrepro" else set()
            )
            found |= {node.module, *names, *lazy}
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "srlrepro":
            found.add(PUBLIC.get(node.attr, "srlrepro"))  # a public name, loaded as it is used
    parts = [name.split(".") for name in found]
    return {".".join(words[:n]) for words in parts for n in range(1, len(words) + 1)}


def code_of(start: str) -> str:
    """SHA-256 of a file and of everything that it imports (`closure`): names and contents."""
    digest = hashlib.sha256()
    for name in closure(start):
        digest.update(Path(name).name.encode() + b"\0" + (ROOT / name).read_bytes() + b"\0")
    return digest.hexdigest()


def _file(name: str) -> Path | None:
    """The file of a module of the project; None of any other name."""
    if name.split(".")[0] not in HOUSES:
        return None
    path = ROOT.joinpath(*name.split("."))
    return next((p for p in (path.with_suffix(".py"), path / "__init__.py") if p.is_file()), None)


def _code(path: Path) -> str:
    if path.suffix != ".ipynb":
        return path.read_text(encoding="utf-8")
    cells = read_json(path)["cells"]
    return "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")


@cache
def closure(start: str) -> list[str]:
    """The file ``start`` and the files of the project that it imports; sorted paths from the checkout."""
    found: set[Path] = set()
    waiting = [ROOT / start]
    while waiting:
        path = waiting.pop()
        if path not in found:
            found.add(path)
            waiting += [file for name in _imported(_code(path)) if (file := _file(name)) is not None]
    names = [p.relative_to(ROOT).as_posix() if p.is_relative_to(ROOT) else str(p) for p in sorted(found)]
    return [name for name in names if name not in WITHOUT]
