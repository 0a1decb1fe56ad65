"""The replication as a folder of HTML pages: README, executed notebooks, figures. No network, no script.

The site mirrors the tree of the repository, so that the relative links of README and notebooks hold; only
links to what becomes a page change their suffix. Formulas become MathML, which browsers draw by themselves.
"""

import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import jinja2
import nbformat
from latex2mathml.converter import convert
from nbconvert import HTMLExporter
from nbconvert.filters.markdown_mistune import IPythonRenderer, MarkdownWithMath
from pygments.formatters import HtmlFormatter
from traitlets.config import Config

from srlrepro.documents import ROOT, TEMPLATES
from srlrepro.files import ResultError, existing, require_writable
from srlrepro.verdicts import LONG, THREE

SITE = ROOT / "site"
TEMPLATE = TEMPLATES / "site.html.jinja"
KEPT = (THREE, *LONG)  # results of which the site tells, if they are there
INDEX = "README.md"  # the document that becomes index.html
WITHOUT_DEFAULTS = {"enabled": True, "remove_cell_tags": ["parameters"]}  # papermill's cell says which held
SECTION = re.compile(r'<h2 id="([^"]+)">(.*?)</h2>')
HEADING = re.compile(r"<h1[^>]*>(.*?)</h1>")


def slug(heading: str) -> str:
    """The name by which a link reaches a heading, as on GitHub."""
    return re.sub(r"[^\w\- ]", "", re.sub(r"<[^>]+>", "", heading)).strip().lower().replace(" ", "-")


class Renderer(IPythonRenderer):
    """Markdown of one page: formulas as MathML, headings by name, every link passed through ``resolve``."""

    def __init__(self, resolve: Callable[[str], str]) -> None:
        super().__init__(escape=False)
        self.resolve = resolve

    def heading(self, text: str, level: int, **attrs: Any) -> str:
        """A heading that links reach."""
        return f'<h{level} id="{slug(text)}">{text}</h{level}>\n'

    def link(self, text: str, url: str, title: str | None = None) -> str:
        """A link within the site."""
        return super().link(text, self.resolve(url), title)

    def image(self, text: str, url: str, title: str | None = None) -> str:
        """A picture of the site, which leads to itself: on a small screen it is shown small."""
        address = self.resolve(url)
        return super().link(super().image(text, address, title), address)

    def inline_math(self, body: str) -> str:
        """A formula in a line."""
        return convert(body)

    def block_math(self, body: str) -> str:
        """A formula of its own."""
        return convert(body, display="block")


class Site:
    """The pages and files of the site of one checkout.

    Args:
        root: the checkout; every path below is relative to it.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        folders = [root / "notebooks" / "executed" / name for name in KEPT]
        found = [path.relative_to(root) for folder in folders for path in sorted(folder.rglob("[!.]*.ipynb"))]
        self.notebooks = {str(path): str(path.with_suffix(".html")) for path in found}
        texts = [
            path.relative_to(root) for folder in (root, root / "docs") for path in sorted(folder.glob("*.md"))
        ]
        self.documents = {str(path): str(path.with_suffix(".html")) for path in texts} | {INDEX: "index.html"}
        self.pages = self.documents | self.notebooks
        self.files: set[str] = set()  # what pages link to or show, to be copied
        self.exporter = HTMLExporter(
            template_name="basic", config=Config({"TagRemovePreprocessor": WITHOUT_DEFAULTS})
        )

    def resolve(self, page: str, url: str) -> str:
        """The site's address of what ``page`` names ``url``; files that are no pages are noted for copying.

        Raises:
            ResultError: there is no such file in the checkout.
        """
        parts = urlsplit(url)
        if parts.scheme or parts.netloc or not parts.path:
            return url
        target = os.path.normpath(Path(page).parent / unquote(parts.path))
        if target in self.pages:
            address = os.path.relpath(self.pages[target], Path(self.pages[page]).parent)
            return parts._replace(path=Path(address).as_posix()).geturl()
        if target.startswith("..") or not (self.root / target).is_file():
            raise ResultError(f"{page} names {url}, which is not there")
        self.files.add(target)
        return url

    def markdown(self, page: str, source: str) -> str:
        """Markdown of a page as HTML."""
        renderer = Renderer(lambda url: self.resolve(page, url))
        return MarkdownWithMath(renderer=renderer).render(source)

    def notebook(self, page: str) -> str:
        """An executed notebook as HTML."""
        content = nbformat.read(existing(self.root / page), as_version=4)
        self.exporter.register_filter("markdown2html", lambda source: self.markdown(page, source))
        html: str = self.exporter.from_notebook_node(content)[0]
        return html

    def figures(self) -> Iterator[dict[str, str]]:
        """The pictures of the kept results, each with the files that belong to it."""
        for name in KEPT:
            for path in sorted((self.root / "figures" / name).glob("*.png")):
                files = {
                    s[1:]: str(path.with_suffix(s).relative_to(self.root)) for s in (".png", ".pdf", ".csv")
                }
                self.files.update(files.values())
                yield {"name": f"{name}: {path.stem}", **files}

    def render(self) -> dict[str, str]:
        """{address: HTML} of every page.

        Raises:
            ResultError: a link leads nowhere.
        """
        environment = jinja2.Environment(
            loader=jinja2.FileSystemLoader(TEMPLATE.parent),
            undefined=jinja2.StrictUndefined,
            trim_blocks=True,
        )
        template = environment.get_template(TEMPLATE.name)
        bodies = {page: self.notebook(page) for page in self.notebooks}
        for page in self.documents:
            bodies[page] = self.markdown(page, existing(self.root / page).read_text(encoding="utf-8"))
        headings = {page: "".join(HEADING.findall(body)[:1]) for page, body in bodies.items()}
        listed = [
            {"group": str(Path(page).parent), "name": Path(page).stem, "address": address}
            | {"heading": headings[page]}
            for page, address in self.notebooks.items()
        ]
        others = {self.pages[page]: headings[page] for page in self.documents if page != INDEX}
        common = {"style": HtmlFormatter().get_style_defs(".highlight"), "documents": others}
        sections = dict(SECTION.findall(bodies[INDEX]))
        of_index = {"figures": list(self.figures()), "notebooks": listed, "sections": sections}
        pages = {}
        for page, body in bodies.items():
            address = self.pages[page]
            top = Path(os.path.relpath(".", Path(address).parent)).as_posix()
            values = common | (of_index if page == INDEX else {}) | {"body": body, "page": page, "top": top}
            pages[address] = template.render(values)
        return pages

    def write(self, folder: Path) -> None:
        """Write every page, and copy every file that one of them names, to a folder that is replaced.

        Raises:
            ResultError: a link leads nowhere, a file is missing, or the folder cannot be written.
        """
        require_writable(folder.parent)
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent) as work:
            new = Path(work, folder.name)
            for address, text in self.render().items():
                (new / address).parent.mkdir(parents=True, exist_ok=True)
                (new / address).write_text(text, encoding="utf-8")
            for name in sorted(self.files):
                (new / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(existing(self.root / name), new / name)
            shutil.rmtree(folder, ignore_errors=True)
            new.rename(folder)
