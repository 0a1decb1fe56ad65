"""Documents from templates: README, REPORT, pages of docs/, cards. Every number in them comes from results.

The document ``NAME`` is rendered from ``docs/templates/NAME.jinja``; the cards of policies/, where there are
policies, from ``docs/templates/cards``. Templates take what they tell from `Facts`, so that two documents
that tell the same thing have it from the same place.
"""

from collections.abc import Iterator
from pathlib import Path

import jinja2

from replication import policies
from replication.digests import changed, write_digests
from replication.evidence.verdicts import LONG, THREE
from replication.facts import Facts
from srlrepro.storage.files import ResultError, beside

ROOT = Path(__file__).resolve().parent.parent
DOCS, FIGURES = ROOT / "docs", ROOT / "figures"
TEMPLATES = DOCS / "templates"
POLICIES = "policies"  # the folder of policies and regions to take home
TOP = ("README.md", "REPORT.md")  # the other documents lie in docs/


def documents() -> list[str]:
    """Paths of all documents in the repository, README and REPORT first, cards last."""
    pages = sorted(path.stem for path in TEMPLATES.glob("*.md.jinja"))
    cards = sorted(policies.cards(ROOT / POLICIES))
    cards = [policies.INDEX, *cards] if cards else []
    documents = [*TOP, *(f"docs/{page}" for page in pages if page not in TOP)]
    return [*documents, *(f"{POLICIES}/{card}" for card in cards)]


def render(document: str, figures: Path = FIGURES) -> str:
    """The text of one of the `documents`; `ResultError`: a table of the results (in figures) is missing."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    place = Path(document)
    if place.parent.name == POLICIES:
        card, told = policies.facts(ROOT / POLICIES, place.name)
        return environment.get_template(f"cards/{card}.md.jinja").render(told)
    return environment.get_template(f"{place.name}.jinja").render(facts=Facts(ROOT, figures))


def stale() -> list[str]:
    """The documents that differ from what the results and the configuration say.

    And what else in docs/ is not as its digest there says.
    """
    found = [d for d in documents() if not (ROOT / d).exists() or (ROOT / d).read_text("utf-8") != render(d)]
    return list(dict.fromkeys([*found, *(f"docs/{name}" for name in changed(ROOT / "docs"))]))


def check() -> None:
    """Raise `ResultError` if a document is `stale`."""
    if found := stale():
        raise ResultError(f"stale: {', '.join(found)}; run python -m replication documents")


def write() -> None:
    """Render every document, and renew the digests of docs/; nothing is written if a table is missing.

    Raises:
        ResultError: one is.
    """
    for document, text in {document: render(document) for document in documents()}.items():
        (ROOT / document).parent.mkdir(exist_ok=True)
        with beside(ROOT / document) as temporary:
            temporary.write_text(text, encoding="utf-8")
    write_digests(ROOT / "docs")


def refresh(name: str) -> Iterator[str]:
    """`write` the documents, if they tell of the results of this name; yields what was rendered."""
    if name in (THREE, *LONG):
        write()
        yield from documents()
