"""Sphinx: README, REPORT, docs and the executed notebooks as a site to be read offline.

Nothing is executed. Formulas become MathML, which browsers draw by themselves. What a notebook brings along
is not trusted: its metadata goes, a directive fails the build, its HTML is cut down to tables and text,
remote pictures become text, and a policy in each page forbids every script but the theme's. A link to a file
that is no page copies that file; a link that leads nowhere is a warning, which ``-W`` makes an error.
"""

import hashlib
import json
import re
import shutil
from base64 import b64encode
from html import unescape
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from xml.etree.ElementTree import tostring

import furo
import nh3
from docutils import nodes
from latex2mathml.converter import convert_to_element
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.logging import getLogger

ROOT = Path(__file__).resolve().parents[1]
GROUPS = ("full", "seeds_10", "multiverse", "hypotheses")  # results that the site shows, if they are there
EXECUTED = "notebooks/executed"
TAGS = nh3.ALLOWED_TAGS - {"a", "area", "img", "map"}  # of a notebook's HTML: nothing that leads elsewhere
DIRECTIVE = re.compile(r"((?:`{3,}|~{3,})[^\S\n]*)\{")  # could include any file, or send the reader elsewhere
THEME = (Path(furo.__file__).parent / "theme" / "furo" / "base.html").read_text(encoding="utf-8")
[SCRIPT] = re.findall("<script>(.*?)</script>", THEME, re.DOTALL)  # chooses dark or light
DIGEST = b64encode(hashlib.sha256(SCRIPT.encode()).digest()).decode()
POLICY = f"""<meta http-equiv="Content-Security-Policy" content="default-src 'none'; base-uri 'none';
 script-src 'self' file: 'sha256-{DIGEST}'; style-src 'self' file: 'unsafe-inline';
 img-src 'self' file: data:; form-action 'self' file:">"""

project = html_title = "Which states should a safe region be learned from?"
extensions = ["myst_nb"]
root_doc = "README"
include_patterns = ["README.md", "REPORT.md", "docs/*.md", *(f"{EXECUTED}/{g}/**.ipynb" for g in GROUPS)]
exclude_patterns = [p.name for p in ROOT.iterdir() if p.is_dir() and p.name not in ("docs", "notebooks")]
smartquotes = False  # text as on GitHub
highlight_language = "text"  # blocks without a language are commands and listings
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 6  # links to headings, as on GitHub
myst_disable_syntax = ["myst_role", "myst_target", "myst_line_comment", "myst_block_break"]  # GitHub has none
nb_execution_mode = "off"
nb_merge_streams = True  # lines printed one by one belong together
nb_mime_priority_overrides = [("html", "application/javascript", None), ("html", "image/svg+xml", None)]
html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_copy_source = html_use_index = html_show_copyright = False
html_show_search_summary = False  # a page opened from a disk may not fetch another
html_last_updated_fmt = None  # two builds give the same bytes


def pages(app: Sphinx, folder: str) -> list[str]:
    """The pages below a folder, in order."""
    found = [page for page in app.env.found_docs if page.startswith(f"{folder}/")]
    return sorted(found, key=lambda page: Path(page).name.replace("__", " "))


def words(page: str, parts: slice) -> str:
    """Parts of the name of a notebook: the first is its title, the others are its parameters."""
    return ", ".join(Path(page).name.split("__")[parts]).replace("_", " ")


def toctree(entries: list[str], *options: str) -> str:
    """Entries of the sidebar, as Markdown."""
    return "\n".join(["\n\n```{toctree}", ":hidden:", *options, *entries, "```\n"]) if entries else ""


def complete(app: Sphinx, page: str, source: list[str]) -> None:
    """Add the sidebar and a list of figures to the first page; make a notebook safe, and name it in full."""
    if page == root_doc:
        source[0] += "\n\n## Every figure, with its table\n\n| figure | | |\n|---|---|---|\n"
        for path in sorted(path for group in GROUPS for path in ROOT.glob(f"figures/{group}/*.pdf")):
            stem = path.relative_to(ROOT).with_suffix("").as_posix()
            source[0] += f"| {stem} | [PDF]({stem}.pdf) | [table]({stem}.csv) |\n"
        texts = sorted(app.env.found_docs - {root_doc, *pages(app, EXECUTED)})
        source[0] += toctree([f"/{text}" for text in texts], ":caption: Documents")
        for group in GROUPS:
            runs = pages(app, f"{EXECUTED}/{group}/runs")[1:]  # below the first one
            shown = [other for other in pages(app, f"{EXECUTED}/{group}") if other not in runs]
            entries = [f"{words(other, slice(1))} </{other}>" for other in shown]
            source[0] += toctree(entries, f":caption: Notebooks: {group}")
    elif page.startswith(EXECUTED):
        content = json.loads(source[0])
        # Some metadata would have the notebook executed.
        content["metadata"] = {"language_info": {"name": "python", "pygments_lexer": "ipython3"}}
        for cell in content["cells"]:
            defaults = "parameters" in cell["metadata"].get("tags", [])  # the injected parameters hold
            cell["metadata"] = {"tags": ["remove-cell"]} if defaults else {}
            if cell["cell_type"] == "markdown":
                cell["source"] = DIRECTIVE.sub(r"\1.{", "".join(cell["source"]))
        folder, parameters = str(Path(page).parent), words(page, slice(1, None))
        place = ", ".join(filter(None, [*folder.split("/")[2:], parameters]))
        first = content["cells"][0]
        first["source"] = re.sub(r"\A(# .+)", rf"\1 ({place})", "".join(first["source"]))
        if folder.endswith("/runs") and page == pages(app, folder)[0]:
            entries = [f"{words(run, slice(1, None))} </{run}>" for run in pages(app, folder)[1:]]
            first["source"] += toctree(entries)
        source[0] = json.dumps(content)


def clean(app: Sphinx, tree: nodes.document, page: str = "") -> None:
    """Take from a page what is not safe, give every picture a text, and copy notebooks that are no pages."""
    for raw in tree.findall(nodes.raw):
        raw[:] = [nodes.Text(nh3.clean(raw.astext(), tags=TAGS))]
    for section in reversed([*tree.findall(nodes.section)]):  # innermost headings first
        for image in section.findall(nodes.image):
            image["alt"] = image.get("alt") or section[0].astext()
    for image in [*tree.findall(nodes.image)]:
        if urlsplit(image["uri"]).netloc or urlsplit(image["uri"]).scheme not in ("", "data"):
            image.replace_self(nodes.Text(image.get("alt", "picture")))
    for link in [*tree.findall(addnodes.pending_xref)]:
        file = f"{link['reftarget']}.ipynb"
        if link["reftarget"] not in app.env.found_docs and (ROOT / file).is_file():
            link.replace_self(addnodes.download_reference("", "", *link.children, reftarget=f"/{file}"))


def check(app: Sphinx, env: BuildEnvironment) -> None:
    """Warn of every link to a file outside of the checkout."""
    for name in [*env.dlfiles, *env.images]:
        if not {ROOT, Path(app.doctreedir)} & {*(ROOT / name).resolve().parents}:
            getLogger(__name__).warning("a page names %s, outside of the checkout", name)


def formula(writer: Any, node: nodes.Element) -> None:
    """Write a formula; its text may look like HTML, and stays text."""
    display = "block" if isinstance(node, nodes.math_block) else "inline"
    math = convert_to_element(node.astext(), display=display)
    for part in math.iter():
        part.text = unescape(part.text or "")
    writer.body.append(tostring(math, encoding="unicode"))
    raise nodes.SkipNode


def prepare(app: Sphinx) -> None:
    """Keep the pictures of notebooks with the other intermediate files, not beside the site."""
    app.env.mystnb_config = app.env.mystnb_config.copy(output_folder=str(app.doctreedir / "outputs"))


def protect(app: Sphinx, page: str, template: str, context: dict[str, Any], tree: Any) -> None:
    """Put the policy at the top of a page."""
    context["metatags"] = POLICY + context.get("metatags", "")


def finish(app: Sphinx, error: Exception | None) -> None:
    """Remove the intermediate files, which name folders of this machine; index.html is the first page."""
    shutil.rmtree(app.doctreedir, ignore_errors=True)
    if not error:
        shutil.copyfile(app.outdir / f"{root_doc}.html", app.outdir / "index.html")


def setup(app: Sphinx) -> None:
    """Put the functions above in their places."""
    app.add_html_math_renderer("mathml", (formula, None), (formula, None))
    app.connect("builder-inited", prepare, priority=900)  # after MyST-NB's own
    app.connect("source-read", complete)
    app.connect("doctree-read", clean, priority=100)  # before titles, pictures and links are collected
    app.connect("doctree-resolved", clean)
    app.connect("env-check-consistency", check)
    app.connect("html-page-context", protect)
    app.connect("build-finished", finish)
