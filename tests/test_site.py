"""The site: every link and picture is there, the bytes are the same each time, a real browser is content."""

import json
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit
from urllib.request import urlopen

import nbformat
import pytest
import websocket
from bs4 import BeautifulSoup

from srlrepro.files import ResultError
from srlrepro.site import KEPT, ROOT, Site, slug

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
WIDTHS = {"desktop": 1280, "phone": 390}
PATIENCE = 60.0  # s for the browser to start, or for one page
INSPECT = """(async () => {
  const images = [...document.images];
  images.forEach(image => image.loading = "eager");
  await Promise.all(images.map(image => image.decode().catch(() => {})));
  return JSON.stringify({
    missing: images.filter(image => !image.naturalWidth).map(image => image.src.slice(0, 200)),
    width: document.documentElement.scrollWidth,
    shown: innerWidth,
    formulas: document.querySelectorAll("math").length,
  });
})()"""


def wrong_links(site: Path) -> list[str]:
    """Links and pictures of a folder of pages that lead nowhere, or out of it to a file."""
    pages = {path: BeautifulSoup(path.read_text(), "html.parser") for path in site.rglob("*.html")}
    wrong = []
    for path, page in pages.items():
        for tag, name in [(t, n) for n in ("href", "src") for t in page.find_all(attrs={n: True})]:
            parts = urlsplit(str(tag[name]))
            if parts.scheme == "data" or (tag.name == "a" and parts.scheme == "https"):
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            inside = not parts.scheme and target.is_relative_to(site.resolve()) and target.is_file()
            anchored = not parts.fragment or (target in pages and pages[target].find(id=parts.fragment))
            if not (inside and anchored):
                wrong.append(f"{path.relative_to(site)}: {tag[name]}")
    return wrong


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A checkout with one executed notebook, which shows an animation, and the figure beside it."""
    root = tmp_path / "checkout"
    notebook = nbformat.v4.new_notebook()
    notebook.cells = [
        nbformat.v4.new_markdown_cell(r"# Is $\tfrac12 x \le 1$?"),
        nbformat.v4.new_code_cell("1 + 1", execution_count=1),
        nbformat.v4.new_markdown_cell("![](../../../figures/full/move.gif)"),
    ]
    (root / "notebooks" / "executed" / "full").mkdir(parents=True)
    (root / "figures" / "full").mkdir(parents=True)
    (root / "docs").mkdir()
    nbformat.write(notebook, root / "notebooks" / "executed" / "full" / "01_a.ipynb")
    for name in ("curve.png", "curve.pdf", "curve.csv", "move.gif"):
        (root / "figures" / "full" / name).write_bytes(b"x")
    (root / "README.md").write_text(
        "# All\n\n[b](#the-b) [a](notebooks/executed/full/01_a.ipynb)\n\n## The *b*\n"
    )
    (root / "REPORT.md").write_text("# Report\n\n[all](README.md#the-b)\n")
    (root / "docs" / "claims.md").write_text("# Claims\n\n[all](../README.md#the-b)\n")
    return root


def test_headings_are_named_as_on_github() -> None:
    assert slug("What is where?") == "what-is-where"
    assert slug("Δ, <em>α</em> and `p_t`") == "δ-α-and-p_t"


def test_links_pictures_and_formulas(checkout: Path, tmp_path: Path) -> None:
    Site(checkout).write(tmp_path / "site")
    page = (tmp_path / "site" / "notebooks" / "executed" / "full" / "01_a.html").read_text()
    assert wrong_links(tmp_path / "site") == []
    assert "<math" in page and "$" not in page and 'src="../../../figures/full/move.gif"' in page
    assert 'href="../index.html#the-b"' in (tmp_path / "site" / "docs" / "claims.html").read_text()
    (tmp_path / "site" / "figures" / "full" / "curve.csv").unlink()
    assert wrong_links(tmp_path / "site") == ["index.html: figures/full/curve.csv"]


@pytest.mark.parametrize("url", ["nothing.md", "../../etc/passwd", "docs"])
def test_a_link_that_leads_nowhere_is_refused(url: str, checkout: Path, tmp_path: Path) -> None:
    (checkout / "README.md").write_text(f"# All\n\n[x]({url})\n")
    with pytest.raises(ResultError, match=f"README.md names {url}"):
        Site(checkout).write(tmp_path / "site")
    assert not (tmp_path / "site").exists()


def test_documents_and_results_that_come_later_are_taken_in(checkout: Path, tmp_path: Path) -> None:
    """A report beside the README, and the figures of another kept set; the index leads to both."""
    (checkout / "REPORT.md").write_text("# What we found\n\n![](figures/seeds_10/curve.png)\n")
    shutil.copytree(checkout / "figures" / "full", checkout / "figures" / "seeds_10")
    Site(checkout).write(tmp_path / "site")
    index = (tmp_path / "site" / "index.html").read_text()
    assert 'href="./REPORT.html">What we found</a>' in index and 'src="figures/seeds_10/curve.png"' in index
    assert wrong_links(tmp_path / "site") == []


def test_the_parameters_shown_are_those_that_held(checkout: Path, tmp_path: Path) -> None:
    notebook = nbformat.v4.new_notebook()
    for text, tag in (("SEED = 1", "parameters"), ("SEED = 2", "injected-parameters")):
        notebook.cells.append(nbformat.v4.new_code_cell(text, metadata={"tags": [tag]}))
    nbformat.write(notebook, checkout / "notebooks" / "executed" / "full" / "02_b.ipynb")
    Site(checkout).write(tmp_path / "site")
    page = (tmp_path / "site" / "notebooks" / "executed" / "full" / "02_b.html").read_text()
    shown = BeautifulSoup(page, "html.parser").get_text()
    assert "SEED = 2" in shown and "SEED = 1" not in shown


def test_a_site_that_cannot_be_made_leaves_the_old_one(checkout: Path, tmp_path: Path) -> None:
    Site(checkout).write(tmp_path / "site")
    (checkout / "figures" / "full" / "curve.csv").unlink()
    with pytest.raises(ResultError, match=r"curve.csv"):
        Site(checkout).write(tmp_path / "site")
    assert wrong_links(tmp_path / "site") == []
    assert [path.name for path in tmp_path.iterdir() if path.name != "checkout"] == ["site"]


def test_an_old_site_is_replaced(checkout: Path, tmp_path: Path) -> None:
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "old.html").write_text("old")
    Site(checkout).write(tmp_path / "site")
    assert not (tmp_path / "site" / "old.html").exists()


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site of this checkout."""
    folder = tmp_path_factory.mktemp("built") / "site"
    Site(ROOT).write(folder)
    return folder


@pytest.mark.slow
def test_the_whole_site_is_complete_and_the_same_each_time(built: Path, tmp_path: Path) -> None:
    """A page for every executed notebook that is kept; no script; twice the same bytes."""
    executed = [p for name in KEPT for p in (ROOT / "notebooks" / "executed" / name).rglob("[!.]*.ipynb")]
    pages = list(built.rglob("*.html"))
    texts = [path for folder in (ROOT, ROOT / "docs") for path in folder.glob("*.md")]
    assert wrong_links(built) == [] and len(pages) == len(executed) + len(texts)
    assert not any("<script" in page.read_text() for page in pages)
    Site(ROOT).write(tmp_path / "again")
    files = sorted(p.relative_to(built) for p in built.rglob("*") if p.is_file())
    assert files == sorted(
        p.relative_to(tmp_path / "again") for p in (tmp_path / "again").rglob("*") if p.is_file()
    )
    assert all((built / f).read_bytes() == (tmp_path / "again" / f).read_bytes() for f in files)


class Browser:
    """One tab of a headless Chromium, driven by its DevTools protocol."""

    def __init__(self, address: str) -> None:
        self.socket = websocket.create_connection(address, timeout=PATIENCE, suppress_origin=True)
        self.count, self.events = 0, list[dict[str, Any]]()
        for domain in ("Page", "Log", "Runtime", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The result of a command; events that come before it are kept."""
        self.count += 1
        self.socket.send(json.dumps({"id": self.count, "method": method, "params": parameters}))
        while (message := json.loads(self.socket.recv())).get("id") != self.count:
            self.events.append(message)
        assert "error" not in message, message
        result: dict[str, Any] = message["result"]
        return result

    def visit(self, url: str, width: int) -> tuple[dict[str, Any], list[str]]:
        """What `INSPECT` finds on a page, and what went wrong on the way."""
        phone = width < WIDTHS["desktop"]
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=844, deviceScaleFactor=1, mobile=phone
        )
        self.events.clear()
        self.call("Page.navigate", url=url)
        while not any(event["method"] == "Page.loadEventFired" for event in self.events):
            self.events.append(json.loads(self.socket.recv()))
        answer = self.call("Runtime.evaluate", expression=INSPECT, awaitPromise=True)
        return json.loads(answer["result"]["value"]), [
            text for e in self.events if (text := self.complaint(e))
        ]

    @staticmethod
    def complaint(event: dict[str, Any]) -> str:
        """What is wrong with an event of a page, if anything; requests must stay on the disk."""
        method, parameters = event["method"], event["params"]
        if method == "Log.entryAdded" and parameters["entry"]["level"] in ("warning", "error"):
            return str(parameters["entry"]["text"])
        if method == "Runtime.consoleAPICalled" and parameters["type"] in ("warning", "error", "assert"):
            return str(parameters["args"])
        if method == "Network.requestWillBeSent" and not parameters["request"]["url"].startswith(
            ("file:", "data:")
        ):
            return f"leaves the disk: {parameters['request']['url']}"
        return method if method in ("Runtime.exceptionThrown", "Network.loadingFailed") else ""


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Browser]:
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        pytest.skip(f"none of {', '.join(BROWSERS)} is installed")
    command = [program, "--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0"]
    process = subprocess.Popen(
        [*command, f"--user-data-dir={tmp_path / 'profile'}", "about:blank"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        port, end = tmp_path / "profile" / "DevToolsActivePort", time.monotonic() + PATIENCE
        while not (port.exists() and port.read_text().count("\n")) and time.monotonic() < end:
            time.sleep(0.1)
        tabs = json.load(urlopen(f"http://127.0.0.1:{port.read_text().splitlines()[0]}/json/list"))
        yield Browser(next(tab["webSocketDebuggerUrl"] for tab in tabs if tab["type"] == "page"))
    finally:
        process.terminate()
        process.wait()


@pytest.mark.slow
@pytest.mark.parametrize("device", WIDTHS)
def test_a_browser_shows_every_page_without_complaint(device: str, built: Path, browser: Browser) -> None:
    """From the file system: nothing on the console, every picture, no page wider than the screen."""
    for page in sorted(built.rglob("*.html")):
        found, complaints = browser.visit(page.as_uri(), WIDTHS[device])
        assert complaints == [] and found["missing"] == [], page.name
        assert found["width"] <= found["shown"] == WIDTHS[device], page.name
        assert found["formulas"] == page.read_text().count("<math"), page.name


@pytest.mark.slow
def test_the_browser_check_can_fail(tmp_path: Path, browser: Browser) -> None:
    """A missing picture, an error of a script, a request to the network, and a page too wide for a phone."""
    page = tmp_path / "bad.html"
    page.write_text(
        "<meta name=viewport content='width=device-width'><script>console.error('wrong')</script>"
        "<img src=none.png><img src='http://127.0.0.1:9/x.png'><div style='width: 900px'>wide</div>"
    )
    found, complaints = browser.visit(page.as_uri(), WIDTHS["phone"])
    assert len(found["missing"]) == 2 and found["width"] > WIDTHS["phone"]
    assert any("wrong" in c for c in complaints) and any("leaves the disk" in c for c in complaints)
