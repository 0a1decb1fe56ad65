"""Documents from templates: README.md and REPORT.md, in which every number comes from results."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2

from srlrepro.storage.files import ResultError, beside

ROOT = Path(__file__).resolve().parent.parent
TEMPLATES, FIGURES = ROOT / "docs", ROOT / "figures"


@dataclass(frozen=True)
class Document:
    """A file of the repository that is rendered from ``docs/NAME.jinja``.

    Attributes:
        name: of the file.
        command: of ``python -m srlrepro``, which writes it.
        context: gives what the template is filled with.
    """

    name: str
    command: str
    context: Callable[[], dict[str, Any]]

    def render(self) -> str:
        """The text.

        Raises:
            ResultError: a table of the results is missing.
        """
        environment = jinja2.Environment(
            loader=jinja2.FileSystemLoader(TEMPLATES),
            undefined=jinja2.StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
            keep_trailing_newline=True,
        )
        return environment.get_template(f"{self.name}.jinja").render(self.context())

    def is_stale(self) -> bool:
        """Whether the file differs from what the results and the configuration say."""
        path = ROOT / self.name
        return not path.exists() or path.read_text(encoding="utf-8") != self.render()

    def check(self) -> None:
        """Refuse a stale file.

        Raises:
            ResultError: it is.
        """
        if self.is_stale():
            raise ResultError(f"{self.name} is stale: run python -m srlrepro {self.command}")

    def write(self) -> None:
        """Render the file."""
        text = self.render()
        with beside(ROOT / self.name) as temporary:
            temporary.write_text(text, encoding="utf-8")
