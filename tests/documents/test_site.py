"""The book: it is built without network and warnings, leads nowhere wrong, and is readable for everyone."""

import importlib
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from chromium import CHROMIUM, Page, browser

from replication.documents import DOCS, ROOT
from srlrepro import PUBLIC

pytestmark = pytest.mark.slow
KINDS = [
    "docs/index",
    "README",
    "REPORT",
    "docs/method",
    "docs/figures",
    "docs/parts",
    "docs/check",
    "docs/api",
]
KINDS += ["docs/api/region", "notebooks/executed/full/06_learning_performance"]
KINDS += [
    page for page in ("policies/README", "policies/alpha_0__delta_1.1") if (ROOT / f"{page}.md").exists()
]
WIDTHS, SCHEMES = (1280, 390), ("light", "dark")
OUTSIDE = {
    "https://www.sphinx-doc.org/",
    "https://pradyunsg.me",
    "https://github.com/pradyunsg/furo",
}  # the footer
LEAST_CONTRAST, OF_LARGE = 4.5, 3.0  # WCAG 2, level AA
CONTRAST = """(() => {
  const rgba = c => { const n = c.match(/[\\d.]+/g).map(Number); return n.length > 3 ? n : n.concat(1); };
  const over = (a, b) => [0, 1, 2].map(i => a[i] * a[3] + b[i] * (1 - a[3])).concat(1);
  const light = c => { const f = v => (v /= 255) <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
                       return 0.2126 * f(c[0]) + 0.7152 * f(c[1]) + 0.0722 * f(c[2]); };
  const found = [], texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const text = texts.currentNode.textContent.trim(), box = texts.currentNode.parentElement;
    if (!text || !box.checkVisibility({opacityProperty: true, visibilityProperty: true}) ||
        box.closest('script, style, noscript, svg, .visually-hidden')) continue;
    const style = getComputedStyle(box), layers = [];
    for (let e = box; e; e = e.parentElement) layers.push(rgba(getComputedStyle(e).backgroundColor));
    const back = layers.reverse().reduce((below, layer) => over(layer, below), [255, 255, 255, 1]);
    const pair = [light(over(rgba(style.color), back)), light(back)].sort((a, b) => b - a);
    const size = parseFloat(style.fontSize), large = size >= 24 || (size >= 18.66 && style.fontWeight >= 700);
    const contrast = (pair[0] + 0.05) / (pair[1] + 0.05);
    if (contrast < (large ? LARGE : LEAST)) found.push(`${contrast.toFixed(2)}: ${text.slice(0, 40)}`);
  }
  return [...new Set(found)];
})()""".replace("LARGE", str(OF_LARGE)).replace("LEAST", str(LEAST_CONTRAST))


class Reader(HTMLParser):
    """What a page names: ids, links, and what it loads."""

    def __init__(self) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.without_text: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = {name: value or "" for name, value in attrs}
        self.ids |= {found[name] for name in ("id", "name") if name in found}
        if tag == "a" and "href" in found:
            self.links.append(found["href"])
        if tag in ("img", "script") and "src" in found:
            self.loads.append(found["src"])
        if tag == "link" and found.get("rel") == "stylesheet":
            self.loads.append(found["href"])
        if tag == "img" and not found.get("alt"):
            self.without_text.append(found["src"])


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The book, built as ``./reproduce.sh site`` does, where no network can be reached."""
    out = tmp_path_factory.mktemp("book") / "site"
    command = [sys.executable, "-m", "sphinx", "-c", "docs", "-b", "html", "-q", "-W", "--keep-going", "."]
    nowhere = {f"{kind}_proxy": "http://127.0.0.1:9" for kind in ("http", "https", "HTTP", "HTTPS")}
    done = subprocess.run(
        [*command, str(out)], cwd=ROOT, env=os.environ | nowhere, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture(scope="module")
def read(site: Path) -> dict[Path, Reader]:
    found = {}
    for path in sorted(site.rglob("*.html")):
        found[path] = Reader()
        found[path].feed(path.read_text(encoding="utf-8"))
    return found


def test_every_link_leads_to_a_file_of_the_book_and_a_place_in_it(read: dict[Path, Reader]) -> None:
    wrong, outside = [], set()
    for path, page in read.items():
        for link in [*page.links, *page.loads]:
            parts = urlsplit(link)
            if parts.scheme == "data":
                continue
            if parts.scheme or parts.netloc:
                outside.add(link)
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            known = read[target].ids if target in read else {unquote(parts.fragment)}
            if not target.exists() or (parts.fragment and unquote(parts.fragment) not in known):
                wrong.append(f"{path.name}: {link}")
    assert wrong == [] and outside <= OUTSIDE


def test_nothing_is_loaded_from_elsewhere_and_every_picture_has_a_text(read: dict[Path, Reader]) -> None:
    for path, page in read.items():
        assert page.without_text == [], path
        assert [load for load in page.loads if urlsplit(load).scheme not in ("", "data")] == [], path


def test_the_book_begins_at_its_first_page(site: Path, read: dict[Path, Reader]) -> None:
    assert read[site / "index.html"].links == ["docs/index.html"]
    chapters = {link.partition("#")[0] for link in read[site / "docs" / "index.html"].links}
    assert {
        f"../{page}.html" if "/" not in page else f"{page.removeprefix('docs/')}.html" for page in KINDS[1:8]
    } <= chapters


def test_every_public_name_and_every_module_stands_in_the_api(site: Path, read: dict[Path, Reader]) -> None:
    ids = set().union(*(page.ids for path, page in read.items() if path.parent == site / "docs" / "api"))
    for name, module in PUBLIC.items():
        assert f"{module}.{name}" in ids, f"docs/api/ has no page of the room of {module}"
    rooms = {path.stem for path in (ROOT / "srlrepro").iterdir() if not path.stem.startswith("__")}
    told = {path.stem for path in (DOCS / "api").glob("*.md")}
    assert rooms - {"command_line"} == told, "docs/api/ has one page for each room"


def test_docstrings_are_shown_as_they_are_written(site: Path) -> None:
    """Their signs mark nothing up: D_ud and |D_ud| stay, and equations keep their lines."""
    text = (site / "docs" / "api" / "samplers.html").read_text(encoding="utf-8")
    assert "|D_ud| = αk" in text and "system-message" not in text
    module = importlib.import_module("srlrepro.region.safety_map")
    equation = next(
        line.strip() for line in (module.__doc__ or "").splitlines() if line.startswith("    Γ(y)")
    )
    found = (site / "docs" / "api" / "region.html").read_text(encoding="utf-8")
    assert equation.partition("=")[0].strip() in re.findall(r"<pre>(.*?)</pre>", found, re.DOTALL)[0] + found
    assert "Alias for field number" not in found and "set_fit_request" not in found


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    if CHROMIUM is None:
        pytest.skip("this machine has no Chromium")
    with browser() as found:
        yield found


@pytest.mark.parametrize("kind", KINDS)
def test_in_a_browser_a_page_is_whole_and_readable(kind: str, site: Path, page: Page) -> None:
    page.complaints.clear()
    page.visit((site / f"{kind}.html").as_uri())
    broken = "[...document.images].filter(i => i.loading != 'lazy' && !i.naturalWidth).map(i => i.src)"
    assert page.value(broken) == []
    for width in WIDTHS:
        for scheme in SCHEMES:
            page.look(width, scheme)
            assert page.value("document.documentElement.scrollWidth") <= width, (
                f"{width} px: it scrolls sideways"
            )
            assert page.value(CONTRAST) == [], f"{width} px, {scheme}: too little contrast"
    assert page.complaints == []


def test_the_contrast_is_seen(site: Path, page: Page) -> None:
    page.visit((site / "docs" / "check.html").as_uri())
    page.look(1280, "light")
    page.value("document.querySelector('article p').style.color = '#999'")
    assert len(page.value(CONTRAST)) == 1


def test_without_scripts_all_is_readable(site: Path, page: Page) -> None:
    page.ask("Emulation.setScriptExecutionDisabled", value=True)
    try:
        for kind in KINDS:
            page.visit((site / f"{kind}.html").as_uri())
            shown = "[...document.querySelectorAll('article *')].filter(e => e.checkVisibility()).length"
            every = "document.querySelectorAll('article *:not(script, style, style *, annotation)').length"
            assert page.value(shown) > 0.9 * page.value(every) > 5, kind
    finally:
        page.ask("Emulation.setScriptExecutionDisabled", value=False)
