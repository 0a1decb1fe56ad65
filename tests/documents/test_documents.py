"""README, REPORT and the pages say what the results say, briefly, and nothing that is not so."""

import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pandas as pd
import pytest
from judged import measures, write_judged, write_studies

from replication import documents
from replication.documents import DOCS, FIGURES, ROOT, render
from replication.evidence.claims import MEASURE_COLUMNS, load_claims
from replication.evidence.verdicts import LARGER, LONG
from srlrepro.storage.files import ResultError, read_json, write_table
from workflow.command_line import make_parser, make_verify_parser

NOT_RUN = "*Not run: `./reproduce.sh --"
TEXTS = sorted([*ROOT.glob("*.md"), *DOCS.glob("*.md")])
TOP = {name: (ROOT / name).read_text(encoding="utf-8") for name in documents.TOP}
PAPERS = sum(claim.layer == "a" for claim in load_claims())


def test_the_documents_are_up_to_date() -> None:
    assert documents.stale() == []


def test_a_changed_result_changes_them(larger: Path) -> None:
    path = larger / "seeds_10" / "claims.csv"
    assert "with 10 runs per condition" in render("README.md", larger)
    path.write_text(path.read_text(encoding="utf-8").replace(",10,", ",11,"), encoding="utf-8")
    assert "with 11 runs per condition" in render("README.md", larger)


def test_a_stale_document_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(documents, "ROOT", tmp_path)
    monkeypatch.setattr(documents, "documents", lambda: ["README.md", "docs/claims.md"])
    monkeypatch.setattr(documents, "render", lambda document: f"text of {document}")
    documents.write()
    documents.check()
    (tmp_path / "docs" / "claims.md").write_text("another text")
    with pytest.raises(ResultError, match=r"stale: docs/claims\.md; run python -m replication documents"):
        documents.check()


MOST = {"lines": 150, "bytes": 8000, "words": 4000, "rows of a table": 10}  # the former two of README


def lengths(readme: str, report: str) -> dict[str, int]:
    """Of README, and of REPORT with its longest table; by the names of `MOST`."""
    tables = re.findall(r"(?:^\|.*\n)+", report, re.MULTILINE)
    rows = max(table.count("\n") for table in tables) - 2  # without the head
    found = len(readme.splitlines()), len(readme.encode()), len(report.split()), rows
    return dict(zip(MOST, found, strict=True))


def test_they_are_short() -> None:
    found = lengths(*TOP.values())
    assert all(found[name] <= most for name, most in MOST.items()), found


def test_they_are_short_whatever_the_results_are(larger: Path) -> None:
    write_judged(larger / "seeds_10", measures(turned=True))
    (larger / "calibrated").mkdir()
    write_table(larger / "calibrated" / "measures.csv", measures())
    found = lengths(*(render(name, larger) for name in documents.TOP))
    assert all(found[name] <= most for name, most in MOST.items()), found


def test_no_number_is_missing_or_contradicts_another(larger: Path) -> None:
    for path in TEXTS:
        assert not re.search(r"\bnan\b|\bNone\b", path.read_text(encoding="utf-8")), path
    made = {name: render(name, larger) for name in documents.TOP}
    assert not any(re.search(r"\bnan\b|\bNone\b", text) for text in made.values())
    rates = {name: set(re.findall(r"[\d.]+, [\d.]+ and [\d.]+ %", text)) for name, text in made.items()}
    assert rates["README.md"] == {
        "19, 9 and 0.3 %",
        "25, 12 and 0.65 %",
        "50, 30 and 1 %",
        "19.2, 9.0 and 0.3 %",
    }
    assert rates["README.md"] <= rates["REPORT.md"]


ANSWERS = {  # sentences that depend on signs: as the paper says, turned round, and of a single seed
    "holds": (
        "A larger α makes K fail less often.",
        "α = 1 ends with a lower reward.",
        "Stopping trials early speeds up learning.",
    ),
    "turned": (
        "A larger α does not make K fail less often.",
        "α = 1 does not end with a lower reward.",
        "speeds up learning with one α.",
    ),
    "one seed": (
        "Whether a larger α changes that is open.",
        "Whether α = 1 ends with a lower reward is open.",
        "speeds up learning is open.",
    ),
}


@pytest.mark.parametrize("results", ANSWERS)
@pytest.mark.parametrize("name", documents.TOP)
def test_the_answer_at_each_delta_follows_the_signs(larger: Path, results: str, name: str) -> None:
    table = measures(turned=results == "turned")
    table = table[table["seed"] == 0] if results == "one seed" else table
    write_judged(larger / "seeds_10", table)
    text = render(name, larger)
    for other, sentences in ANSWERS.items():
        assert [text.count(sentence) for sentence in sentences] == [3 * (other == results)] * 3
    best = {
        "holds": "The final policy is better than a free learner's.",
        "turned": "with one α.",
        "one seed": "Whether the final",
    }
    assert best[results] in text


def test_the_headline_counts_the_papers_sentences_alone(larger: Path) -> None:
    text = render("README.md", larger)
    assert f"**Of its {PAPERS} sentences** that data can test: {PAPERS} reproduced, with 10 runs" in text
    write_judged(larger / "seeds_10", pd.DataFrame(columns=list(MEASURE_COLUMNS)))
    assert f"{PAPERS} not measured" in render("docs/claims.md", larger) + render("docs/index.md", larger)


def test_what_more_joints_say_stands_in_the_report(larger: Path) -> None:
    rows = [
        ("as written", 3, 250, "visits", 1.1, 5, -0.1, -0.2, -0.05),
        ("best", 3, 250, "visits", 1.1, 5, 0.1, 0.05, 0.2),
    ]
    columns = ["pair", "links", "k", "law", "delta", "datasets", "advantage", "low", "high"]
    write_table(larger / "joints" / "joints.csv", pd.DataFrame(rows, columns=columns))
    states = pd.DataFrame({"id": list("abc"), "state": ["holds", "holds", "open"]})
    write_table(larger / "joints" / "joints_predictions.csv", states)
    report = render("REPORT.md", larger)
    assert "the map as written accepts fewer unsafe states than an SVM in 0 of 1 cases (more in 1)" in report
    assert "fewer unsafe states than the best of the whole state in 1 of 1 cases" in report
    assert "in 1 of 1 cases (more in 0) on states that a random policy" in render("README.md", larger)
    assert "holds 2, fails 0, open 1" in report and report.count(f"{NOT_RUN}joints`") == 1
    names = ["contrast", "outcome", "links", "delta", "datasets", "estimate", "low", "high", "sign"]
    found = [("map − whole state", "caution", n, 1.1, 3, 0.1, 0.05, 0.15, "more") for n in (2, 3)]
    write_table(larger / "joints" / "joints_contrasts.csv", pd.DataFrame(found, columns=names))
    write_table(larger / "joints" / "joints_trained_predictions.csv", states)
    report = render("REPORT.md", larger)
    assert "between supervised learners 2 of 2 contrasts are decided" in report
    assert "Of the 1 contrasts at n = 3, 1 is decided." in report
    assert report.count("holds 2, fails 0, open 1") == 2 and f"{NOT_RUN}joints`" not in report


def test_what_the_studies_say_stands_in_report_and_readme(larger: Path) -> None:
    write_studies(larger)
    report, readme = render("REPORT.md", larger), render("README.md", larger)
    assert "| log odds that K succeeds | 60 [20, 90] % | 60 [20, 90] % | 60 [20, 90] % |" in report
    assert "more than half for the log odds that K succeeds (each *open*)" in report
    assert "- **The draw of the data** is an estimated 60 to 60 % of the variance" in readme
    assert "log odds of success at Δ = 1.1 and 1.5 and 4." in readme
    assert "| 1.1 | SVM, whole state | 0.250 | 0.250 |" in report
    fell = "the median of violations in a training behind the region"
    assert f"p_t from 0.5 to 0.95 takes {fell}, over all α, from 22 to 12 at Δ = 1.1, from 80 to 42" in report
    assert "the SVM has fewer violations than the region (each *holds*)" in report
    counts = (
        "0 of 4 effects of α on violations matter (2 open), 2 of 2 of an SVM of the whole state (0 open)."
    )
    assert counts in readme and counts in report
    assert "Of 12 differences from the data as written (α = 0),\n6 leave out 0" in report
    assert "interval, 0.6 would by chance" in report
    assert "violations per 1000 steps: learners-law -0.2 (Δ = 1.1), learners-law -0.2 (Δ = 4).\n" in report
    assert (
        "in 4 of 4 cases. Predicted" in report and "nearer in 2 of 4 cases; fewer violations in 2." in readme
    )


def test_every_part_that_was_not_run_says_so(larger: Path) -> None:
    """And is not said to be so where it was."""
    report, opened = render("REPORT.md", larger), "Not run, and not claimed: "
    missing = "; ".join(text for name, (_, text) in LONG.items() if name != LARGER)
    assert f"{opened}{missing}." in render("README.md", larger)
    for name in ("multiverse", "crossed", "caution", "shift", "joints"):
        assert f"{NOT_RUN}{name}`" in report
    write_studies(larger)
    write_table(larger / "calibrated" / "measures.csv", measures())
    readme, report = (render(name, larger) for name in documents.TOP)
    assert f"{opened}the multiverse; more joints." in readme and "**Γ's evidence** lies" in readme
    assert report.count(NOT_RUN) == 3 and "; 0 verdicts differ." in report
    by_step = "*Not run: measures by the steps of a training"
    assert by_step not in report
    (larger / "seeds_10" / "verdict_by_step.csv").unlink()
    assert by_step in render("REPORT.md", larger)
    (larger / "seeds_10" / "claims.csv").unlink()
    assert f"{opened}{LONG[LARGER][1]}; " in render("README.md", larger)


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
    assert (
        f"took {measured['full']['minutes']} min and {measured['tests']['minutes']} min" in TOP["README.md"]
    )
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
