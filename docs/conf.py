"""Sphinx: README, REPORT, docs, cards, the API and the executed notebooks as a book to be read offline.

No notebook is executed; the package is imported, for its docstrings. Formulas become MathML, which browsers
draw by themselves. What a notebook brings along is not trusted: its metadata goes, a directive fails the
build, its HTML is cut down to tables and text, remote pictures become text, and a policy in each page forbids
every script but the theme's. A link to a file that is no page copies that file; a link that leads nowhere is
a warning, which ``-W`` makes an error.
"""

import hashlib
import json
import os
import re
import shutil
from base64 import b64encode
from html import unescape
from importlib import import_module
from inspect import getdoc, signature
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from xml.etree.ElementTree import tostring

os.environ["NUMBA_DISABLE_JIT"] = "1"  # kernels stay functions, whose docstrings can be read

import furo
import nh3
from docutils import nodes
from latex2mathml.converter import convert_to_element
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.logging import getLogger

from srlrepro import PUBLIC

ROOT = Path(__file__).resolve().parents[1]
# Results that the site shows, if they are there.
GROUPS = ("full", "seeds_10", "multiverse", "crossed", "caution", "shift", "joints")
EXECUTED = "notebooks/executed"
TAGS = nh3.ALLOWED_TAGS - {"a", "area", "img", "map"}  # of a notebook's HTML: nothing that leads elsewhere
DIRECTIVE = re.compile(r"((?:`{3,}|~{3,})[^\S\n]*)\{")  # could include any file, or send the reader elsewhere
THEME = (Path(furo.__file__).parent / "theme" / "furo" / "base.html").read_text(encoding="utf-8")
[SCRIPT] = re.findall("<script>(.*?)</script>", THEME, re.DOTALL)  # chooses dark or light
DIGEST = b64encode(hashlib.sha256(SCRIPT.encode()).digest()).decode()
POLICY = f"""<meta http-equiv="Content-Security-Policy" content="default-src 'none'; base-uri 'none';
 script-src 'self' file: 'sha256-{DIGEST}'; style-src 'self' file: 'unsafe-inline';
 img-src 'self' file: data:; form-action 'self' file:">"""

MARKS = re.compile(
    r"(`+[^`]+`+|\*\*[^*]+\*\*)|([*|]|(?<=\w)_(?=\W|$))"
)  # in a docstring: names in backticks, and other signs
ARRAY = re.compile(
    r"[~\w.]*ndarray\[[~\w.]*tuple\[[~\w.]*Any, \.\.\.\], [~\w.]*dtype\[(?:[~\w.]*\.)?(\w+)\]\]"
)
LONGEST_SIGNATURE = 300  # characters
DRAWING = re.compile(r'<img [^>]*src="[^"]*_images/(loop\.svg)"[^>]*/?>')
ENTRANCE = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>Safe regions, replicated</title>
<meta http-equiv="refresh" content="0; url=docs/index.html"><a href="docs/index.html">The book</a></html>
"""

# The book: its chapters, and which pages stand below others; what is not there yet is left out.
CHAPTERS = {
    "README": "In short",
    "REPORT": "Findings",
    "docs/method": "The method",
    "docs/figures": "The figures",
    "docs/parts": "Use the parts",
    "policies/README": "Take home",
    "docs/check": "Check us",
    "docs/api": "API",
}
BELOW = {"docs/api": "docs/api", "policies/README": "policies"}  # page: folder of those below it
EXPLORER = "docs/explorer.html"  # a page of its own, copied as it is

project = "Which states should a safe region be learned from?"
html_title = html_short_title = "Safe regions, replicated"
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
root_doc = "docs/index"
include_patterns = [
    "README.md",
    "REPORT.md",
    "docs/**.md",
    "policies/*.md",
    *(f"{EXECUTED}/{g}/**.ipynb" for g in GROUPS),
]
exclude_patterns = [
    p.name for p in ROOT.iterdir() if p.is_dir() and p.name not in ("docs", "notebooks", "policies")
] + [f"{EXECUTED}/*/universes"]  # hundreds of one kind
smartquotes = False  # text as on GitHub
highlight_language = "text"  # blocks without a language are commands and listings
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 6  # links to headings, as on GitHub
myst_disable_syntax = ["myst_role", "myst_target", "myst_line_comment", "myst_block_break"]  # GitHub has none
default_role = "py:obj"  # names in docstrings lead to what they name, if that is public
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
maximum_signature_line_length = 80
python_use_unqualified_type_names = True
napoleon_use_ivar = True
add_module_names = toc_object_entries = False
suppress_warnings = ["ref.python"]  # two classes may have an attribute of one name
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


def modules(room: str) -> list[str]:
    """Names of the modules of a room of the package."""
    folder = ROOT / "srlrepro" / room
    files = sorted(folder.glob("*.py")) if folder.is_dir() else [folder.with_suffix(".py")]
    names = [path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".") for path in files]
    return [name for name in names if not name.endswith("__init__")]


def public() -> str:
    """The public names, each with the first line of its docstring, in reStructuredText."""
    entries = []
    for name, module in PUBLIC.items():
        first = [(getdoc(getattr(import_module(module), name)) or "").partition("\n")[0]]
        plain(None, "", "", None, None, first)
        entries.append(f"* :py:obj:`~{module}.{name}`: {first[0]}")
    return "\n".join(entries)


def contents(app: Sphinx) -> str:
    """The sidebar: chapters, documents, notebooks."""
    known = app.env.found_docs
    chapters = [f"{title} </{page}>" for page, title in CHAPTERS.items() if page in known]
    below = {page for folder in BELOW.values() for page in pages(app, folder)}
    texts = sorted(known - {root_doc, *CHAPTERS, *below, *pages(app, EXECUTED)})
    source = toctree(chapters, ":caption: The book")
    source += toctree([f"/{text}" for text in texts], ":caption: Documents")
    for group in GROUPS:
        runs = pages(app, f"{EXECUTED}/{group}/runs")[1:]  # below the first one
        shown = [other for other in pages(app, f"{EXECUTED}/{group}") if other not in runs]
        entries = [f"{words(other, slice(1))} </{other}>" for other in shown]
        source += toctree(entries, f":caption: Notebooks: {group}")
    return source


def complete(app: Sphinx, page: str, source: list[str]) -> None:
    """Add the sidebar and the API; make a notebook safe, and name it in full."""
    if page == root_doc:
        source[0] += contents(app)
    if page in BELOW:
        source[0] += toctree([f"/{other}" for other in pages(app, BELOW[page]) if other != page])
    if page == "docs/api":
        source[0] += f"\n## The public names\n\n```{{eval-rst}}\n{public()}\n```\n"
    elif page.startswith("docs/api/"):
        for module in modules(Path(page).name):
            source[0] += (
                f"\n## {module.partition('.')[2]}\n"
                + f"\n```{{eval-rst}}\n.. automodule:: {module}\n   :members:\n```\n"
            )
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
    if not page and app.env.docname == root_doc:  # its picture and its list have a look of their own
        for part in [*tree.findall(nodes.image), *tree.findall(nodes.bullet_list)]:
            part["classes"].append("first")
    for raw in tree.findall(nodes.raw):
        raw[:] = [nodes.Text(nh3.clean(raw.astext(), tags=TAGS))]
    for section in reversed([*tree.findall(nodes.section)]):  # innermost headings first
        for image in section.findall(nodes.image):
            image["alt"] = image.get("alt") or section[0].astext()
    for image in [*tree.findall(nodes.image)]:
        if urlsplit(image["uri"]).netloc or urlsplit(image["uri"]).scheme not in ("", "data"):
            image.replace_self(nodes.Text(image.get("alt", "picture")))
    for link in [*tree.findall(addnodes.download_reference)]:
        if str(link["reftarget"]).lstrip("/").removeprefix("../") in (EXPLORER, Path(EXPLORER).name):
            place = os.path.relpath(EXPLORER, Path(page or app.env.docname).parent)
            link.replace_self(nodes.reference("", "", *link.children, refuri=place))
    for link in [*tree.findall(addnodes.pending_xref)]:
        file = f"{link['reftarget']}.ipynb"
        if link["reftarget"] not in app.env.found_docs and (ROOT / file).is_file():
            link.replace_self(addnodes.download_reference("", "", *link.children, reftarget=f"/{file}"))


def check(app: Sphinx, env: BuildEnvironment) -> None:
    """Warn of every link to a file outside of the checkout."""
    for name in [*env.dlfiles, *env.images]:
        if not {ROOT, Path(app.doctreedir)} & {*(ROOT / name).resolve().parents}:
            getLogger(__name__).warning("a page names %s, outside of the checkout", name)


def plain(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Let a docstring be plain text: its signs mark nothing up, and what is set off and indented stays so."""
    text: list[str] = []
    gap, inside, literal = False, True, False  # after an empty line; the last text was indented; set off now
    for line in lines:
        indented = line.startswith("    ")
        if indented and gap and not inside:
            literal = True
            text += ["::", ""]
        literal = literal and (indented or not line)
        text.append(line if literal else MARKS.sub(lambda found: found[1] or f"\\{found[2]}", line))
        gap, inside = not line, indented if line else inside
    lines[:] = text


def shorten(
    app: Sphinx, what: str, name: str, obj: Any, options: Any, arguments: str | None, returned: str | None
) -> tuple[str, str | None] | None:
    """Call arrays arrays; where a signature is still long, leave the names of the arguments alone."""
    if arguments is None:
        return None
    arguments, returned = (
        text and ARRAY.sub(r"NDArray[\1]", text).replace("~typing.", "").replace("<factory>", "...")
        for text in (arguments, returned)
    )
    if len(arguments) > LONGEST_SIGNATURE:
        names = [n for n in signature(obj).parameters if n != "self"]
        arguments = f"({', '.join(names)})"
    return arguments, returned if returned is None or len(returned) < LONGEST_SIGNATURE else None


def skip(app: Sphinx, what: str, name: str, obj: Any, skipped: bool, options: Any) -> bool | None:
    """Leave out what libraries add to a class: fields of a named tuple, and scikit-learn's requests."""
    named = str(getattr(obj, "__doc__", "")).startswith("Alias for field number")
    return True if named or (name.startswith("set_") and name.endswith("_request")) else None


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


def drawing(name: str) -> str:
    """The drawing of a name, as part of a page."""
    return (ROOT / "docs" / "_static" / name).read_text(encoding="utf-8")


def protect(app: Sphinx, page: str, template: str, context: dict[str, Any], tree: Any) -> None:
    """Put the policy at the top of a page; a drawing becomes part of it, and so takes its colours."""
    context["metatags"] = POLICY + context.get("metatags", "")
    tree_of_pages = context.get(
        "furo_navigation_tree", ""
    )  # its captions lack what readers of screens ask for
    context["furo_navigation_tree"] = tree_of_pages.replace('role="heading"', 'role="heading" aria-level="2"')
    context["body"] = DRAWING.sub(lambda found: drawing(found[1]), context.get("body", ""))


def finish(app: Sphinx, error: Exception | None) -> None:
    """Remove the intermediate files, which name folders of this machine; index.html leads to the book."""
    shutil.rmtree(app.doctreedir, ignore_errors=True)
    if not error:
        (app.outdir / "index.html").write_text(ENTRANCE, encoding="utf-8")
        if (ROOT / EXPLORER).is_file():
            shutil.copyfile(ROOT / EXPLORER, app.outdir / EXPLORER)


def setup(app: Sphinx) -> None:
    """Put the functions above in their places."""
    app.add_html_math_renderer("mathml", (formula, None), (formula, None))
    app.connect("builder-inited", prepare, priority=900)  # after MyST-NB's own
    app.connect("source-read", complete)
    app.connect("autodoc-process-docstring", plain, priority=400)  # before napoleon
    app.connect("autodoc-process-signature", shorten)
    app.connect("autodoc-skip-member", skip)
    app.connect("doctree-read", clean, priority=100)  # before titles, pictures and links are collected
    app.connect("doctree-resolved", clean)
    app.connect("env-check-consistency", check)
    app.connect("html-page-context", protect, priority=900)  # after the theme
    app.connect("build-finished", finish)
