"""The page in a browser: it draws, answers to mouse, touch and keys, and says nothing to the console."""

import itertools
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import CHROMIUM, Page, chromium
from learned import Learned
from test_build import data_of, unpacked

from replication.explorer.build import arms
from replication.plots import style
from srlrepro.dynamics.closed_loop import ClosedLoop
from srlrepro.settings.config import Config

pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="Chromium is not installed: the page cannot be shown"
)

SIZES = {"desk": (1280, 900), "phone": (390, 844)}
CELLS, STRENGTHS = 48, (62, 235)  # per side of the picture around x; opacity where h is 0, and 1
MARGINS = (34, 4, 4, 30)  # px left, above, right and below it
PICTURES = ("pendulum", "plane", "slice", "timeline")
SMOOTH = 20  # ms between two pictures, of the fastest tenth: a page too slow in itself has none so fast


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with chromium(tmp_path_factory.mktemp("browser")) as found:
        yield found


def settle(tab: Page, ms: int = 300) -> None:
    tab.run(f"new Promise((done) => setTimeout(done, {ms}))")


def text(tab: Page, name: str) -> str:
    return str(tab.run(f"document.getElementById('{name}').textContent"))


def box(tab: Page, name: str) -> list[float]:
    code = f"(() => {{ const b = document.getElementById('{name}').getBoundingClientRect();"
    found: list[float] = tab.run(f"{code} return [b.left, b.top, b.width, b.height]; }})()")
    return found


def colours(tab: Page, name: str) -> int:
    """How many colours a picture has."""
    pixels = "c.getContext('2d').getImageData(0, 0, c.width, c.height).data"
    code = f"const c = document.getElementById('{name}'), data = {pixels};"
    return int(tab.run(f"(() => {{ {code} return new Set(new Uint32Array(data.buffer)).size; }})()"))


@pytest.mark.parametrize(("size", "dark"), [*itertools.product(SIZES, (False, True))])
def test_the_page_is_drawn_and_fits(tab: Page, page: Path, size: str, dark: bool) -> None:
    tab.open(page, *SIZES[size], dark=dark, touch=size == "phone")
    settle(tab, 800)
    assert tab.complaints == []
    assert [r for r in tab.requests if not r.startswith("data:")] == [page.resolve().as_uri()]
    assert tab.run("document.documentElement.scrollWidth <= innerWidth")
    for name in PICTURES:
        assert colours(tab, name) > 5, name
    assert re.fullmatch(r"h\(x\) = [01]ln\(x\) = [01]l\(x\) = [01]\S.*\.", text(tab, "verdict"))
    ink, paper = tab.run(
        "[getComputedStyle(document.body).color, getComputedStyle(document.body).backgroundColor]"
    )
    brightness = [sum(map(float, re.findall(r"[\d.]+", colour)[:3])) for colour in (ink, paper)]
    assert (brightness[0] > brightness[1]) == dark


def test_text_has_contrast(tab: Page, page: Path) -> None:
    """4.5 between any text and the surface behind it, as WCAG asks, light and dark."""
    code = """(() => {
      const c = new OffscreenCanvas(1, 1).getContext('2d', {willReadFrequently: true});
      const rgb = (...layers) => {
        c.clearRect(0, 0, 1, 1);
        for (const layer of layers) { c.fillStyle = layer; c.fillRect(0, 0, 1, 1); }
        return c.getImageData(0, 0, 1, 1).data;
      };
      const linear = (v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
      const light = (p) => [0.2126, 0.7152, 0.0722].reduce((s, w, i) => s + w * linear(p[i] / 255), 0);
      const poor = [];
      const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
      while (walker.nextNode()) {
        const e = walker.currentNode.parentElement;
        if (!walker.currentNode.textContent.trim() || e.closest('script, noscript, svg, option')) continue;
        const layers = [];
        for (let n = e; n; n = n.parentElement) layers.unshift(getComputedStyle(n).backgroundColor);
        const a = light(rgb(...layers)), b = light(rgb(...layers, getComputedStyle(e).color));
        const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
        if (ratio < 4.5) poor.push([walker.currentNode.textContent, ratio]);
      }
      return poor;
    })()"""
    for dark in (False, True):
        tab.open(page, *SIZES["desk"], dark=dark)
        settle(tab)
        assert tab.run(code) == []


def test_the_point_is_dragged_smoothly(tab: Page, page: Path) -> None:
    tab.open(page, *SIZES["desk"])
    settle(tab)
    left, top, width, height = box(tab, "slice")
    before = [text(tab, "coordinates"), text(tab, "probability")]
    tab.run("window.times = []; (function f(t) { times.push(t); requestAnimationFrame(f); })(0)")
    tab.mouse("Pressed", left + 0.5 * width, top + 0.5 * height)
    tab.run("times.length = 0")
    for i in range(60):
        tab.mouse("Moved", left + (0.5 + 0.006 * i) * width, top + (0.5 - 0.007 * i) * height)
    gaps = tab.run("times.slice(1).map((t, i) => t - times[i]).sort((a, b) => a - b)")
    tab.mouse("Released", left + 0.85 * width, top + 0.1 * height)
    settle(tab)
    assert [text(tab, "coordinates"), text(tab, "probability")] != before
    assert text(tab, "verdict").startswith("h(x) = 0") and "l(x) = 0" in text(tab, "verdict")
    assert gaps[len(gaps) // 10] < SMOOTH
    assert tab.complaints == []


def test_the_picture_around_x_is_the_packages(
    tab: Page, page: Path, small: Learned, small_config: Config
) -> None:
    """Colour and strength of its cells are l(x) and h(x), but where lines are drawn over them."""
    tab.open(page, *SIZES["desk"])
    tab.run("document.getElementById('upright').click()")
    before = ""
    while before != (before := tab.run("document.getElementById('slice').toDataURL()")):
        settle(tab, 1500)
    left, top, width, height = MARGINS[0], MARGINS[1], *box(tab, "slice")[2:]
    width, height = width - left - MARGINS[2], height - top - MARGINS[3]
    part = (np.arange(CELLS) + 0.5) / CELLS
    places = [(round(left + width * a), round(top + height * (1 - b))) for a in part for b in part]
    code = f"const c = document.getElementById('slice').getContext('2d'); return {json.dumps(places)}"
    seen = np.array(tab.run(f"(() => {{ {code}.map((p) => [...c.getImageData(...p, 1, 1).data]); }})()"))
    hues = np.array([[int(h[i : i + 2], 16) for i in (1, 3, 5)] for h in (style.UNSAFE, style.SAFE)])
    kinds = np.array([[*hue, strength] for strength in STRENGTHS for hue in hues])
    distance = np.abs(seen[:, None] - kinds).max(axis=2)
    clear = distance.min(axis=1) <= 6
    x = np.zeros((CELLS**2, 6))
    x[:, 0], x[:, 3] = np.array([(a, b) for a in 2 * part - 1 for b in 2 * part - 1]).T
    x *= small_config.paper.state_max
    l, h = ClosedLoop.from_config(small_config, 1.5).predict(x), small[1].predict(x)
    assert clear.mean() > 0.75 and set(h[clear]) == set(l[clear]) == {0, 1}
    np.testing.assert_array_equal(distance.argmin(axis=1)[clear], (2 * h + l)[clear])


def test_a_joint_is_dragged(tab: Page, page: Path) -> None:
    """The tip of the upright pendulum, to the right: then θ3 alone has turned."""
    tab.open(page, *SIZES["desk"])
    tab.run("document.getElementById('upright').click()")
    settle(tab)
    left, top, width, height = box(tab, "pendulum")
    unit = width / (2 * 1.04 * 3)
    tip, elbow = [(left + width / 2, top + height - (y + 0.96) * unit) for y in (3.0, 2.0)]
    tab.mouse("Pressed", *tip)
    tab.mouse("Moved", elbow[0] + unit, elbow[1])
    tab.mouse("Released", elbow[0] + unit, elbow[1])
    settle(tab)
    values = dict(re.findall(r"(d?θ.(?:/dt)?) (−?[\d.]+) rad", text(tab, "coordinates")))
    assert float(values["θ₃"]) == pytest.approx(1.57, abs=0.02)
    assert float(values["θ₁"]) == float(values["θ₂"]) == 0


def test_keys_play_and_step(tab: Page, page: Path) -> None:
    tab.open(page, *SIZES["desk"])
    settle(tab)
    tab.key(" ")
    settle(tab, 500)
    assert text(tab, "play") == "Pause"
    tab.key(" ")
    at = int(tab.run("Number(document.getElementById('scrub').value)"))
    assert at > 5
    tab.key(".")
    assert int(tab.run("Number(document.getElementById('scrub').value)")) == at + 1
    tab.run("document.getElementById('slice').focus()")
    before = text(tab, "coordinates")
    tab.key("ArrowRight")
    settle(tab)
    assert text(tab, "coordinates") != before


def test_choices_redraw(tab: Page, page: Path) -> None:
    tab.open(page, *SIZES["desk"])
    settle(tab)

    def turn(name: str, value: float) -> Any:
        code = f"const e = document.getElementById('{name}'); e.value = {value};"
        tab.run(f"(() => {{ {code} e.dispatchEvent(new Event('input')); }})()")
        settle(tab, 1000)
        return text(tab, "scores"), text(tab, "tested")

    first = text(tab, "scores")
    bold, _ = turn("p_t", 0.02)
    assert bold != first
    heavy, said = turn("delta", 4)
    assert heavy != bold and said.startswith("Δ = 4.0")
    assert tab.complaints == []


def test_the_other_arm_has_its_own_psi_and_scores(tab: Page, page: Path, small: Learned) -> None:
    """At a threshold where the two take different numbers of test states for safe."""
    x = unpacked(data_of(page)["test"]["uniform"]["x"]).reshape(-1, 6).astype(np.float64)
    p = {name: arm.safety(x) for name, arm in arms(small[1]).items()}
    found = {t: [int((p[name] > t).sum()) for name in p] for t in np.arange(0.1, 0.95, 0.05).round(2)}
    p_t = next(t for t, counts in found.items() if len(set(counts)) == 2)
    tab.open(page, *SIZES["desk"])
    code = f"const e = document.getElementById('p_t'); e.value = {p_t}; e.dispatchEvent(new Event('input'))"
    tab.run(f"(() => {{ {code} }})()")
    said, planes = ("Ψ is a small neural network", "Ψ(x) is the mean"), set()
    for name, count, words in zip(p, found[p_t], said, strict=True):
        tab.run(f"document.querySelector('#arm [value=\"{name}\"]').click()")
        settle(tab, 1500)
        assert f"h takes {count} for safe" in text(tab, "scores")
        assert text(tab, "how").startswith(words)
        planes.add(tab.run("document.getElementById('plane').toDataURL()"))
    assert len(planes) == 2 and tab.complaints == []


def test_the_next_activation_is_found(tab: Page, page: Path) -> None:
    tab.open(page, *SIZES["desk"])
    settle(tab)
    tab.key("n")
    settle(tab, 2000)
    assert text(tab, "outcome").startswith("K takes over at")
    assert tab.complaints == []


def test_a_finger_moves_the_point_and_scrolls_beside_it(tab: Page, page: Path) -> None:
    tab.open(page, *SIZES["phone"], touch=True)
    tab.run("document.getElementById('slice').scrollIntoView({block: 'center'})")
    settle(tab)
    left, top, width, height = box(tab, "slice")
    before = text(tab, "coordinates")
    for kind, x in (("touchStart", 0.5), ("touchMove", 0.6), ("touchMove", 0.7)):
        points = [{"x": left + x * width, "y": top + 0.4 * height}]
        tab.ask("Input.dispatchTouchEvent", type=kind, touchPoints=points)
    tab.ask("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    settle(tab)
    assert text(tab, "coordinates") != before
    assert tab.complaints == []
