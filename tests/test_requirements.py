"""What is pinned can be installed by every Python that is promised."""

import re
import tomllib
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parent.parent


def test_every_pinned_package_admits_the_oldest_python() -> None:
    """Of the packages that are installed here; a pin for another system or use is not seen."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    (oldest,) = SpecifierSet(project["requires-python"])
    assert oldest.operator == ">="
    refused = {}
    for name in re.findall(r"^([\w.-]+)==", (ROOT / "constraints.txt").read_text(), re.MULTILINE):
        try:
            needs = distribution(name).metadata["Requires-Python"]
        except PackageNotFoundError:
            continue
        if needs and not SpecifierSet(needs).contains(f"{oldest.version}.0"):
            refused[name] = needs
    assert refused == {}
