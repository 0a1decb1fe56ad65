"""The three houses: each depends only on those before it, and a rule of the workflow knows what it runs."""

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from workflow.sources import HOUSES, WITHOUT, closure

ROOT = Path(__file__).parent.parent
ROOMS = [
    "pins",
    "settings",
    "storage",
    "compiled",
    "dynamics",
    "samplers",
    "region",
    "supervisor",
    "fast_ppo",
    "learner",
    "command_line",
]
MOST_MODULES = 12
SLOW = {"torch", "numba", "scipy", "sklearn", "stable_baselines3", "matplotlib", "pandas", "openTSNE"}
MODULES = sorted(path for house in HOUSES for path in (ROOT / house).rglob("*.py"))
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
SMALL = ["--set", "k=20", "random_rollouts=50"]
RULES = "".join(path.read_text() for path in sorted((ROOT / "workflow" / "rules").glob("*.smk")))


def imports(path: Path) -> set[str]:
    """Dotted names of the project that a module imports."""
    tree = ast.parse(path.read_text())
    names = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.module is not None}
    names |= {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    return {name for name in names if name.split(".")[0] in HOUSES}


def loaded(code: str) -> set[str]:
    """Files of the project that are loaded once the code has run in a process of its own."""
    ask = (
        "\nimport sys, json\n"
        "print('\\n' + json.dumps([getattr(m, '__file__', None) for m in list(sys.modules.values())]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code + ask], cwd=ROOT, capture_output=True, text=True, check=True
    )
    files = [Path(name) for name in json.loads(done.stdout.splitlines()[-1]) if name]
    inside = [path.relative_to(ROOT) for path in files if path.is_relative_to(ROOT)]
    return {path.as_posix() for path in inside if path.parts[0] in HOUSES}


def test_houses_depend_only_on_those_before() -> None:
    up = {
        f"{path.relative_to(ROOT)} imports {name}"
        for path in MODULES
        for name in imports(path)
        if HOUSES.index(name.split(".")[0]) > HOUSES.index(path.relative_to(ROOT).parts[0])
    }
    assert up == set()


def test_rooms_of_the_method_stand_in_the_order_of_the_paper() -> None:
    up = set()
    for path in (path for path in MODULES if path.is_relative_to(ROOT / "srlrepro")):
        room = path.relative_to(ROOT).with_suffix("").parts[1]
        for name in imports(path) if room in ROOMS else ():
            parts = name.split(".")
            if len(parts) > 1 and parts[0] == "srlrepro" and ROOMS.index(parts[1]) > ROOMS.index(room):
                up.add(f"{path.relative_to(ROOT)} imports {name}")
    assert up == set()
    found = {p.with_suffix("").name for p in (ROOT / "srlrepro").iterdir()} - {"__pycache__"}
    assert found == {*ROOMS, "__init__", "__main__"}


def test_no_folder_is_crowded() -> None:
    counts: dict[Path, int] = {}
    for path in (path for path in MODULES if path.name != "__init__.py"):
        counts[path.parent] = counts.get(path.parent, 0) + 1
    assert {str(folder.relative_to(ROOT)): n for folder, n in counts.items() if n > MOST_MODULES} == {}


def test_importing_the_method_is_light_and_drags_no_other_house() -> None:
    code = f"import srlrepro, sys\nassert not {SLOW} & set(sys.modules), {SLOW} & set(sys.modules)"
    assert loaded(code) == {"srlrepro/__init__.py"}


def test_every_public_name_is_there() -> None:
    import srlrepro

    for name in srlrepro.__all__:
        assert getattr(srlrepro, name) is not None
    with pytest.raises(AttributeError, match="nothing"):
        _ = srlrepro.nothing


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_closure_of_a_notebook_holds_what_it_loads(path: Path) -> None:
    """Its import statements are run; what functions import when they are called is in the closure too."""
    cells = json.loads(path.read_text())["cells"]
    code = "\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "code")
    tree = ast.parse("\n".join(line for line in code.splitlines() if not line.startswith(("%", "!"))))
    statements = [ast.unparse(n) for n in tree.body if isinstance(n, (ast.Import, ast.ImportFrom))]
    found = set(closure(f"notebooks/{path.name}"))
    assert loaded("\n".join(statements)) - set(WITHOUT) <= found
    assert f"notebooks/{path.name}" in found


def test_a_public_name_counts_however_it_is_used(tmp_path: Path) -> None:
    for code in ("from srlrepro import LQG", "import srlrepro\nsrlrepro.LQG()"):
        path = tmp_path / f"{len(code)}.py"
        path.write_text(code)
        closure.cache_clear()
        assert "srlrepro/dynamics/lqg.py" in closure(str(path))


def test_every_rule_has_its_notebook_and_what_that_imports_as_inputs() -> None:
    rules = re.split(r"(?m)^rule ", RULES)[1:]
    executing = 0
    for rule in rules:
        executed, named = re.findall(r'execute\("(\w+)"\)', rule), re.findall(r'notebook\("(\w+)"\)', rule)
        assert executed == named, rule.partition(":")[0]
        executing += len(executed)
        assert "values=config" in rule, rule.partition(":")[0]
    assert executing == len(NOTEBOOKS)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("house", "arguments"),
    [
        ("srlrepro", ["data", "--alpha", "0.5", "--out", "{}/data.npz", *SMALL]),
        ("srlrepro", ["region", "--data", "{}/data.npz", "--out", "{}/region.npz", *SMALL]),
    ],
    ids=["data", "region"],
)
def test_the_inputs_of_a_command_hold_what_it_loads(
    house: str, arguments: list[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    place = tmp_path_factory.getbasetemp()
    words = [word.format(place) for word in arguments]
    rule = rf'rule {arguments[0]}:\n    input:\n        command\("{house}", (.*?)\),\n'
    (starts,) = re.findall(rule, RULES)
    files = {file for start in re.findall(r'"([^"]+)"', starts) for file in closure(start)}
    code = f"import sys, runpy\nsys.argv = ['', *{words!r}]\n"
    code += f"try: runpy.run_module({house!r}, run_name='__main__')\n"
    code += "except SystemExit as end: assert not end.code"
    line = {
        "srlrepro/command_line.py",
        "srlrepro/settings/condition.py",
    }  # they read words and hold no number
    assert loaded(code) - set(WITHOUT) - line <= {f"{house}/__main__.py", *files}
