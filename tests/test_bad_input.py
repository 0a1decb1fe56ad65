"""Bad input by generation: what is accepted passes its whole validation, what is refused is one line and 2.

The cases are the same in every run. Their counts end pytest's report: ``pytest tests/test_bad_input.py``.
"""

import io
import json
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from replication.__main__ import main as replication
from replication.evidence import claims
from replication.evidence.claims import MEASURE_COLUMNS
from srlrepro import samplers
from srlrepro.__main__ import main as srlrepro
from srlrepro.region import safe_region
from srlrepro.samplers import MultivariateNormal, TrainingData
from srlrepro.settings.choices import Choices
from srlrepro.settings.config import Config, parse_settings
from srlrepro.settings.fields import ParameterError, one_line
from srlrepro.settings.paper import Paper
from srlrepro.storage import files
from srlrepro.storage.made_of import MadeOf
from workflow import driver, engine, notebooks, plan
from workflow.__main__ import main as workflow
from workflow.command_line import make_parser
from workflow.notebooks import SETTINGS

ROOT = Path(__file__).parent.parent
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
FIELDS = [f for part in (Paper, Choices) for f in fields(part)]
NASTY = ["", " ", "\n", "0\n1", "a\nb", "\r", "\0", "\u2028", "\ud800", "é", "０.５", "α", "x" * 5000]
NASTY += [
    "nan",
    "inf",
    "-inf",
    "1e400",
    "1e-400",
    "9" * 5000,
    "9" * 400,
    str(2**64),
    "-0",
    "-1",
    "0",
    "1",
    "2",
]
NASTY += ["0.5", "1e300", "1e-300", "1_0", "0x10", "true", "True", "None", "none", "null", "[1]", "{}", "k=5"]
NASTY += [
    "../x",
    "/etc/passwd",
    ".",
    "..",
    "~",
    "a/b",
    "@",
    "@x",
    "full",
    "seeds_9",
    "full\n",
    "%s",
    "\x1b[31m",
]
TEXTS = st.sampled_from(NASTY) | st.text(max_size=12) | st.integers().map(str) | st.floats().map(str)
PARTS = st.none() | st.booleans() | st.integers() | st.floats() | TEXTS | st.sampled_from([10**400, -(2**70)])
JSON = st.recursive(
    PARTS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXTS, inner, max_size=3), max_leaves=4
)


def cases(number: int) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """As many cases, the same in every run."""
    checks = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
    phases = [Phase.generate]  # a case that fails is shown as it is: to make it smaller takes minutes
    return settings(
        max_examples=number, derandomize=True, deadline=None, suppress_health_check=checks, phases=phases
    )


class ReachedError(Exception):
    """The validation has been passed: what comes next would take time, or write."""


def reached(*_: Any, **__: Any) -> None:
    raise ReachedError


class Tally:
    """Counts the cases of one surface, and sees that each refusal is as it should be."""

    def __init__(self, surface: str) -> None:
        self.surface, self.counts = surface, Counter[str]()

    def run(self, call: Callable[[], Any], names: tuple[str, ...], value: str, is_file: bool = False) -> None:
        """Run a command line; if it is refused, see that the one line names one of ``names``, and the value.

        is_file: the value names a file, which may be missing or of another kind: that is exit status 1.
        """
        out, error, status = io.StringIO(), io.StringIO(), 0
        try:
            with redirect_stdout(out), redirect_stderr(error):
                status = call() or 0
        except SystemExit as stop:
            status = int(stop.code or 0)
        except ReachedError:
            pass
        line = error.getvalue()
        if status == 0:
            assert line == ""
            self.counts["accepted"] += 1
            return
        assert status == 2 or (is_file and status == 1), line
        assert line.endswith("\n") and line[:-1].isprintable() and len(line) < 2200, line
        assert status == 1 or any(name.lower() in line.lower() for name in names), (names, line)
        assert any(form in line for form in forms(value)), (value, line)
        self.counts["refused"] += 1

    def report(self, record_property: Callable[[str, object], None]) -> None:
        """Hand the counts to pytest's report."""
        kinds = {kind: self.counts[kind] for kind in ("accepted", "refused")}
        record_property("cases", {"bad input": self.surface, "cases": sum(kinds.values())} | kinds)
        assert min(kinds.values()) > 10


def forms(value: str) -> Iterator[str]:
    """How a message may write the start of a value: as one line, quoted, or as the number that it is."""
    start = value[:20]
    yield from (one_line(start), repr(start)[1:-1], one_line(repr(start)[1:-1]))
    for kind in (int, float):
        try:
            yield one_line(kind(value))[:20]
        except ValueError:
            continue
    yield from ("thousands of digits",) if len(value) > 4300 else ()


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with one file of each kind; what would take time or write is cut off behind its validation."""
    rng = np.random.default_rng(0)
    mnd = MultivariateNormal(np.zeros(6), np.eye(6))
    made_of = MadeOf(0.5, 0, Config().until("data"))
    data = TrainingData(0.1 * rng.normal(size=(8, 6)), np.arange(8) % 2, 4, mnd, made_of)
    data.save(tmp_path / "data.npz")
    (tmp_path / "measures").mkdir()
    (tmp_path / "measures" / "a.csv").write_text(",".join(MEASURE_COLUMNS) + "\nx,0,1.1,0,1.0\n")
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / ".lock").touch()
    (tmp_path / "docs").mkdir()
    shutil.copy(ROOT / "docs" / "figures.toml", tmp_path / "docs")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(driver, "VENV", Path(sys.prefix))  # so that the values are checked next
    for module, name in [
        (engine, "run_workflow"),
        (samplers, "visited_states"),
        (safe_region, "embed"),
        (files, "require_writable"),
        (notebooks, "require_writable"),
        (claims, "judge_claims"),
    ]:
        monkeypatch.setattr(module, name, reached)
    for module in (driver, plan):
        monkeypatch.setattr(module, "ROOT", tmp_path)
    return tmp_path


def snapshot(folder: Path) -> list[tuple[str, bytes]]:
    return [(str(p), p.read_bytes() if p.is_file() else b"") for p in sorted(folder.rglob("*"))]


DRIVER = ["--alphas", "--deltas", "--seeds", "--steps", "--set", "--name", "--cores", "--only", "--limit"]


def test_the_command_line_of_reproduce(place: Path, record_property: Callable[[str, object], None]) -> None:
    tally, before = Tally("reproduce.sh"), snapshot(place)
    lists = st.lists(st.tuples(st.sampled_from([*DRIVER, "--nonsense"]), TEXTS), min_size=1, max_size=2)

    @cases(300)
    @given(lists, st.sampled_from([[], ["--quick"], ["--multiverse"], ["--slurm", "--dry-run"]]))
    def one(options: list[tuple[str, str]], switches: list[str]) -> None:
        arguments = [*switches, *(f"{name}={value}" for name, value in options)]
        accepted: list[dict[str, Any]] = []

        def call() -> int:
            try:
                return driver.main(arguments)
            except ReachedError:
                accepted.append(plan.plan(make_parser().parse_args(arguments)))
                raise

        alone = len(options) == 1 and "--multiverse" not in switches
        fields_set = [
            one_line(value.partition("=")[0]) for name, value in options if name == "--set" and "=" in value
        ]
        names = (*(name for name, _ in options), *fields_set, "--multiverse")
        tally.run(call, names, options[0][1].rpartition("=")[2] if alone else "")
        for config in accepted:
            for folder in ("name", "look", "cells"):
                plan.check_name(config[folder])
            assert json.loads(json.dumps(config, allow_nan=False)) == config

    one()
    assert snapshot(place) == before
    tally.report(record_property)


STATE = ["--state", *["0.1"] * 6]
Command = tuple[Callable[[list[str]], int], list[str], list[str]]
COMMANDS: list[Command] = [  # a command line without the options that vary, and these
    (srlrepro, ["data", "--alpha=0.5", "--out=x.npz"], ["--alpha", "--seed", "--out", "--set", "--nonsense"]),
    (srlrepro, ["region", "--data=data.npz", "--out=x.npz"], ["--data", "--seed", "--out", "--set"]),
    (srlrepro, ["label", *STATE], ["--delta", "--set"]),
    (
        srlrepro,
        ["train", "--alpha=none", "--delta=2", "--out=x"],
        ["--alpha", "--delta", "--seed", "--steps", "--set", "--out"],
    ),
    (srlrepro, ["train", "--alpha=1", "--delta=2", "--out=x"], ["--region"]),
    (workflow, ["execute", str(NOTEBOOKS[0]), "x.ipynb"], ["--parameters", "--results", "--limit"]),
    (workflow, ["execute", str(NOTEBOOKS[0])], ["OUTPUT"]),
    (workflow, ["execute"], ["NOTEBOOK x.ipynb"]),
    (workflow, ["snapshot"], ["NOTEBOOKS"]),
    (replication, ["measure", "--out=x.csv"], ["RUN"]),
    (replication, ["claims"], ["MEASURES"]),
    (replication, ["provenance"], ["FIGURE"]),
    (replication, ["beside", "full", "--out=x.png"], ["NAME"]),
    (srlrepro, ["choices"], ["extra"]),
    (replication, ["documents", "--check"], ["extra"]),
    (replication, ["explorer", "--out=x.html"], ["--policies"]),
    (srlrepro, [], ["COMMAND"]),
]
FILES = (
    *("FIGURE", "MEASURES", "--data", "--region", "NOTEBOOK x.ipynb", "NOTEBOOKS", "--parameters", "OUTPUT"),
    *("--out", "RUN", "--policies"),
)
VARIED = st.sampled_from([(main, line, option) for main, line, options in COMMANDS for option in options])


@pytest.mark.filterwarnings("default::RuntimeWarning")  # as outside of tests, where they are held back
def test_every_subcommand(place: Path, record_property: Callable[[str, object], None]) -> None:
    tally, before = Tally("subcommands"), snapshot(place)
    usual = st.sampled_from(["0.5", "1", "k=50", "p_t=0.7", "{}", "measures", "data.npz", "full", "."])
    numbers = st.sampled_from([f for f in FIELDS if f.type in (int, float)])
    setting = st.tuples(numbers, TEXTS).map(lambda pair: f"{pair[0].name}={pair[1]}")

    @cases(500)
    @given(VARIED, TEXTS | usual, setting)
    def one(varied: tuple[Any, list[str], str], text: str, value_of_a_field: str) -> None:
        main, line, option = varied
        value = value_of_a_field if option == "--set" and not text.startswith("k") else text
        if option.startswith("--"):
            arguments = [*line, f"{option}={value}"]
        else:
            value = value.lstrip("-") if value != "-h" else ""
            arguments = [*line, value, *option.split()[1:]]
        name, equals, text = value.partition("=")
        names = (option.split()[0].lstrip("-"), "arguments", "region", *([one_line(name)] if equals else []))
        needs_region = line[:1] == ["train"] and option == "--alpha"  # which the line then names
        shown = "" if needs_region else (text if equals else value).removeprefix("@")
        tally.run(lambda: main(arguments), names, shown, option in FILES)

    one()
    assert snapshot(place) == before
    tally.report(record_property)


def test_the_configuration(record_property: Callable[[str, object], None]) -> None:
    tally = Tally("configuration")
    close = st.sampled_from([f.default for f in FIELDS]) | st.floats(0, 1) | st.integers(1, 100)

    def canonical(config: Config) -> None:
        values = json.loads(json.dumps(config.as_dict(), allow_nan=False))
        assert Config().with_values(**values) == config

    def refusal(call: Callable[[], Any]) -> int:
        try:
            call()
        except ParameterError as error:
            print(error, file=sys.stderr)
            return 2
        return 0

    @cases(300)
    @given(st.sampled_from(FIELDS), JSON | close, TEXTS)
    def one(field: Any, value: Any, text: str) -> None:
        tally.run(
            lambda: refusal(lambda: canonical(Config().with_values(**{field.name: value}))), (field.name,), ""
        )
        given = f"{field.name}={text}"
        tally.run(
            lambda: refusal(lambda: canonical(Config().with_values(**parse_settings([given])))),
            (field.name,),
            text,
        )

    @cases(50)
    @given(TEXTS | st.sampled_from(["self", "k=1", "k", "__class__"]), PARTS)
    def unknown(name: str, value: Any) -> None:
        known = {"k": 5} if name == "k" else {}
        tally.run(
            lambda: refusal(lambda: Config().with_values(**({name: value} | known))), (one_line(name),), ""
        )

    one()
    unknown()
    tally.report(record_property)


def test_parameters_of_notebooks(place: Path, record_property: Callable[[str, object], None]) -> None:
    tally, before = Tally("notebook parameters"), snapshot(place)
    defaults = {path: notebooks.parameters_of(path) for path in NOTEBOOKS}
    known = st.sampled_from([(path, name) for path in NOTEBOOKS for name in defaults[path]])

    @cases(400)
    @given(
        known,
        JSON,
        st.sampled_from(["as it is", "default", "in a list", "in a table", "other name", "alone"]),
    )
    def one(which: tuple[Path, str], value: Any, how: str) -> None:
        path, name = which
        default = defaults[path][name]
        values = {"default": default, "in a list": [value], "in a table": {"k": value}}
        given = {name.lower() if how == "other name" else name: values.get(how, value)}
        text = json.dumps(value if how == "alone" else given)
        inside = value if name == SETTINGS and isinstance(value, dict) else {}
        names = (name, "--parameters", "k = ", *(f"{one_line(key)} = " for key in inside))
        tally.run(lambda: workflow(["execute", str(path), "x.ipynb", "--parameters", text]), names, "")

    one()
    for text in (
        '{"N": 1, "N": 2}',
        "[" * 100_000,
        "{" * 5000,
        '{"SEED": 1e999}',
        "{'SEED': 1}",
        "@",
        "@\0",
        "[1",
        "9" * 5000,
    ):
        line = ["execute", str(NOTEBOOKS[4]), "x.ipynb", "--parameters", text]
        tally.run(lambda line=line: workflow(line), ("--parameters", "missing result"), "", is_file=True)
    assert snapshot(place) == before
    tally.report(record_property)


NO_UTF_8 = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii", "PYTHONCOERCECLOCALE": "0"}


@pytest.mark.parametrize(
    "line",
    [
        ["srlrepro", "--help"],
        ["srlrepro", "choices"],
        ["srlrepro", "data", "--alpha=0.5", "--out=x.npz", "--set", "k=20", "random_rollouts=50"],
        ["srlrepro", "region", "--data=data.npz", "--out=region.npz", "--set", "k=20", "random_rollouts=50"],
        ["replication", "--help"],
        ["replication", "claims", str(ROOT / "figures" / "full" / "measures.csv")],
        ["workflow.driver", "--help"],
    ],
    ids=lambda line: " ".join(line[:2])[:30],
)
def test_a_locale_without_utf_8(line: list[str], tmp_path: Path) -> None:
    command = [sys.executable, "-B", "-m"]
    environment = {"PYTHONPATH": str(ROOT)}
    if "--data=data.npz" in line:
        made = [*command, "srlrepro", "data", "--alpha=0.5", "--out=data.npz", *line[4:]]
        subprocess.run(made, cwd=tmp_path, env=environment, check=True, capture_output=True)
    done = subprocess.run([*command, *line], cwd=tmp_path, env=environment | NO_UTF_8, capture_output=True)
    assert (done.returncode, done.stderr) == (0, b"") and done.stdout.isascii()


def test_a_region_of_too_few_states_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng, mnd = np.random.default_rng(0), MultivariateNormal(np.zeros(6), np.eye(6))
    made_of = MadeOf(0.5, 0, Config().until("data"))
    for states, status in ((2, 2), (3, 0)):  # and the origin
        data = TrainingData(0.1 * rng.normal(size=(states, 6)), np.arange(states) % 2, 1, mnd, made_of)
        data.save(tmp_path / "data.npz")
        line = ["region", "--data", str(tmp_path / "data.npz"), "--out", str(tmp_path / "region.npz")]
        try:
            assert srlrepro(line) == status
        except SystemExit as stop:
            assert stop.code == status == 2
            assert "k = 3: must be a whole number in [4, inf)" in capsys.readouterr().err


@pytest.mark.parametrize(
    "line",
    [
        ["-m", "srlrepro", "data", "--alpha", "0", "--seed", "-1", "--out", "x"],
        ["-m", "srlrepro", "label", "--state", *["0"] * 6, "--set", "control_period=1e-320"],
        ["-m", "workflow", "execute", str(NOTEBOOKS[0]), "x.ipynb", "--parameters", "[" * 9000],
        ["-m", "srlrepro", "train", "--alpha", "none", "--delta", "1", "--out", "a\nb", "--set", "k=\n"],
        ["-B", "-m", "workflow.driver", "--seeds", "9" * 3000],
        ["-B", "-m", "workflow.driver", "--name", "\udcff\n../x"],
    ],
    ids=["seed", "period", "nested", "line feed", "seeds", "name"],
)
def test_a_refusal_of_a_process(line: list[str], tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, *line], cwd=tmp_path, env={"PYTHONPATH": str(ROOT)}, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1 and ("must be" in done.stderr or "invalid" in done.stderr)
    assert list(tmp_path.iterdir()) == []
