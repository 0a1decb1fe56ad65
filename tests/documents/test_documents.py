"""README, REPORT and the pages say what the results say, briefly, and nothing that is not so."""

import re
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from replication import documents
from replication.documents import DOCS, FIGURES, ROOT, render
from srlrepro.storage.files import ResultError, read_json
from workflow.command_line import make_parser, make_verify_parser

NOT_RUN = "*Not run: `./reproduce.sh --"
TEXTS = sorted([*ROOT.glob("*.md"), *DOCS.glob("*.md")])
TOP = {name: (ROOT / name).read_text(encoding="utf-8") for name in documents.TOP}
SENTENCE = re.compile(r"facts\.all\([^)]*\)|facts\.by_delta\[[^]]*\]\.values\(\) \| join == \"[^\"]*\"")


def test_the_documents_are_up_to_date() -> None:
    assert documents.stale() == []


def test_a_changed_result_makes_them_stale(larger: Path) -> None:
    assert render("REPORT.md", FIGURES) == TOP["REPORT.md"]
    path = larger / "seeds_10" / "claims.csv"
    path.write_text(path.read_text(encoding="utf-8").replace(",10,", ",11,"), encoding="utf-8")
    assert "with 11 seeds" in render("README.md", larger) and "with 11 seeds" not in TOP["README.md"]


def test_a_stale_document_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(documents, "ROOT", tmp_path)
    monkeypatch.setattr(documents, "documents", lambda: ["README.md", "docs/claims.md"])
    monkeypatch.setattr(documents, "render", lambda document: f"text of {document}")
    documents.write()
    documents.check()
    (tmp_path / "docs" / "claims.md").write_text("another text")
    with pytest.raises(ResultError, match=r"stale: docs/claims\.md; run python -m replication documents"):
        documents.check()


def test_they_are_short() -> None:
    assert len(TOP["README.md"].splitlines()) <= 150 and len(TOP["README.md"].encode()) <= 8000
    assert len(TOP["REPORT.md"].split()) <= 4000
    tables = re.findall(r"(?:^\|.*\n)+", TOP["REPORT.md"], re.MULTILINE)
    assert tables and max(table.count("\n") for table in tables) - 2 <= 10


def test_no_number_is_missing_or_contradicts_another() -> None:
    for path in TEXTS:
        assert not re.search(r"\bnan\b|\bNone\b", path.read_text(encoding="utf-8")), path
    rates = {name: set(re.findall(r"[\d.]+, [\d.]+ and [\d.]+ %", text)) for name, text in TOP.items()}
    assert len(rates["README.md"]) == 2 and rates["README.md"] <= rates["REPORT.md"]


def test_every_sentence_about_verdicts_is_told() -> None:
    """Where the results say something else the sentence is left out; today none is."""
    sentences = [
        sentence
        for name in documents.TOP
        for sentence in SENTENCE.findall((documents.TEMPLATES / f"{name}.jinja").read_text(encoding="utf-8"))
    ]
    facts = documents.Facts(ROOT, FIGURES)
    environment = documents.jinja2.Environment()
    assert len(sentences) == 11
    for sentence in sentences:
        assert environment.compile_expression(sentence)(facts=facts), sentence


def test_other_verdicts_take_the_sentences_away(larger: Path) -> None:
    """In a larger set by which every claim is partly so, nothing is said to hold or not to."""
    text = render("README.md", larger)
    assert "**The paper asks**" in text and "**It " not in text
    assert "0 are reproduced, 22 partly, 0 are not, and 0 are open, with 10 seeds" in text


def test_every_part_that_was_not_run_says_so(larger: Path) -> None:
    for name in ("multiverse", "hypotheses"):
        shutil.copytree(FIGURES / name, larger / name)
    assert NOT_RUN not in render("REPORT.md", larger)
    for name, table in {"multiverse": "shares.csv", "hypotheses": "hypotheses_better.csv"}.items():
        (larger / name / table).unlink()
        assert f"{NOT_RUN}{name}`" in render("REPORT.md", larger)
    opened = "Not run, and not claimed: "
    assert f"{opened}the multiverse; learners under other hypotheses." in render("README.md", larger)
    (larger / "seeds_10" / "claims.csv").unlink()
    text = render("README.md", larger)
    assert f"{opened}verdicts on a larger set of seeds; " in text and "with 3 seeds per condition" in text


def test_a_missing_table_is_named(larger: Path) -> None:
    (larger / "seeds_10" / "theorem_orders.csv").unlink()
    with pytest.raises(ResultError, match="theorem_orders"):
        render("REPORT.md", larger)


def test_results_that_they_do_not_tell_of_render_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    written: list[bool] = []
    monkeypatch.setattr(documents, "write", lambda: written.append(True))
    for name in ("quick", "steps_100", "seeds_5", "multiverse_quick"):
        assert list(documents.refresh(name)) == [] and not written
    assert list(documents.refresh("full"))[:2] == ["README.md", "REPORT.md"] and written


def test_times_are_those_of_the_records_alone() -> None:
    """A rerun, which takes another time on another processor, must leave the documents as they are."""
    measured = {path.stem: read_json(path) for path in (DOCS / "records").glob("*.json")}
    assert f"took {measured['full']['minutes']} min" in TOP["README.md"]
    assert f"{measured['tests']['minutes']} min; `./reproduce.sh --quick`" in TOP["README.md"]
    assert {"full", "quick", "tests"} <= measured.keys() and not list(FIGURES.glob("*/run_time.json"))


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.name)
def test_links_lead_somewhere(path: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", path.read_text(encoding="utf-8")):
        place, _, heading = link.partition("#")
        target = path.parent / place if place else path
        assert "://" not in link and target.exists(), link
        if heading:
            headings = re.findall(r"^#+ (.*)$", target.read_text(encoding="utf-8"), re.MULTILINE)
            assert heading in {re.sub(r"[^\w -]", "", h.lower()).replace(" ", "-") for h in headings}, link


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.name)
def test_commands_that_are_named_exist(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    for module, command in re.findall(r"python -m (srlrepro|replication|workflow) (\w+)", text):
        parser = import_module(f"{module}.__main__").make_parser()
        assert f"\n    {command}" in parser.format_help(), command
    options = re.findall(r"\./reproduce\.sh([^`#|\n]*)", text)
    help_text = make_parser().format_help() + make_verify_parser().format_help()
    for word in {word for option in options for word in option.split() if word.startswith("--")}:
        assert word in help_text, word


def test_tests_that_are_named_exist() -> None:
    sources = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py"))
    named = re.findall(r"`(test_\w+)`", "".join(path.read_text(encoding="utf-8") for path in TEXTS))
    assert named and all(f"def {name}(" in sources for name in named)


def test_names_in_the_notation_are_those_of_the_code() -> None:
    sources = "".join(
        path.read_text(encoding="utf-8")
        for house in ("srlrepro", "replication")
        for path in (ROOT / house).rglob("*.py")
    )
    table = (DOCS / "notation.md").read_text(encoding="utf-8")
    names = {name for line in table.splitlines() for name in re.findall(r"`(\w+)`", line)}
    assert len(names) > 40 and not [name for name in names if not re.search(rf"\b{name}\b", sources)]


@pytest.mark.parametrize("path", [ROOT / "README.md", DOCS / "parts.md"], ids=lambda path: path.name)
def test_snippets_run(path: Path) -> None:
    blocks = re.findall(r"```python\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) >= 3
    done = subprocess.run([sys.executable, "-c", "".join(blocks)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("[1]" if path.name == "README.md" else "[1 0]")
