"""The page as a reader's browser has it: nothing fails, nothing overflows, everybody can read it.

Run with `pytest -m browser`. It needs Chromium (Debian: `apt-get install chromium`), Playwright
(`pip install '.[browser]'`) and axe-core (`npm install --prefix tests/browser axe-core`).
"""

import importlib.util
import io
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from synthetic_fit import make_fit

from pyburgers.drawing.page_parts import PageSection
from pyburgers.page.comparison_sections import comparison_sections
from pyburgers.page.page import write_report

pytestmark = pytest.mark.browser

WIDTHS = (400, 800, 1280)
FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--disable-background-networking",
)
HOSTILE = "<img src=x onerror=document.title='broken'><script>document.title='broken'</script>"
AXE = Path(os.environ.get("AXE_CORE", Path(__file__).parent / "node_modules" / "axe-core"))


def chromium() -> str:
    """Find a browser, or say what to install."""
    found = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")
    if not found:
        pytest.fail("no Chromium found: apt-get install chromium, or CHROMIUM=/path/to/it.")
    return found


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    if importlib.util.find_spec("playwright") is None:
        pytest.fail("Playwright is missing: pip install '.[browser]' in the checkout.")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        running = driver.chromium.launch(executable_path=chromium(), args=list(FLAGS))
        yield running
        running.close()


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of two fits of the same synthetic data and a measured one, with hostile texts."""
    folder = tmp_path_factory.mktemp("browser")
    runs = folder / "runs"
    fits = [
        make_fit(runs / "first", name="A", chains=2, draws=300, divergences=5, apart=3.0),
        make_fit(runs / "second", name="A", chains=2, draws=300),
        make_fit(
            runs / "a measured one",
            name="B",
            kind="measured",
            chains=2,
            draws=600,
            material=HOSTILE,
            metadata={HOSTILE: HOSTILE},
            command=HOSTILE,
        ),
    ]
    extra = PageSection("part", HOSTILE, (HOSTILE,), details=(HOSTILE,), alarms=(HOSTILE,))
    return write_report(
        fits,
        folder / "page",
        title=HOSTILE,
        command=HOSTILE,
        extras=(extra, *comparison_sections(fits)),
    )


class Visit:
    """A browser tab with the page, and what it complained of."""

    def __init__(self, browser: Any, file: Path, *, width: int = 1280, scheme: str = "light"):
        self.tab = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self.tab.on("console", lambda message: self.complaints.append(message.text))
        self.tab.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.tab.on("request", lambda request: self.requests.append(request.url))
        self.tab.goto(file.as_uri())


@pytest.mark.parametrize("width", WIDTHS)
def test_nothing_fails_and_nothing_overflows(browser: Any, page_file: Path, width: int) -> None:
    visit = Visit(browser, page_file, width=width)
    visit.tab.evaluate("document.querySelectorAll('details').forEach((one) => one.open = true)")
    inside = visit.tab.evaluate("document.documentElement.scrollWidth")
    title = visit.tab.title()
    visit.tab.close()
    assert inside <= width
    assert visit.complaints == []
    assert [url for url in visit.requests if not url.startswith("data:")] == [page_file.as_uri()]
    assert title == HOSTILE  # nothing of it has run


def test_links_of_the_contents_lead_to_what_can_be_seen(browser: Any, page_file: Path) -> None:
    visit = Visit(browser, page_file)
    links = visit.tab.eval_on_selector_all("a[href^='#']", "all => all.map((a) => a.hash)")
    assert len(links) > 10
    for link in dict.fromkeys(links):
        visit.tab.evaluate("(to) => { location.hash = to }", link)
        target = visit.tab.locator(f"[id='{link[1:]}']")
        assert target.count() == 1
        visit.tab.wait_for_function(
            "(id) => { const at = document.getElementById(id).getBoundingClientRect();"
            " return at.height > 0 && at.top < innerHeight && at.bottom > 0; }",
            arg=link[1:],
            timeout=3000,
        )
    visit.tab.close()
    assert visit.complaints == []


def test_a_figure_is_enlarged_and_put_back(browser: Any, page_file: Path) -> None:
    visit = Visit(browser, page_file, width=400)
    before = visit.tab.locator("main .picture svg").count()
    picture = visit.tab.locator("main .picture svg").first
    width = picture.bounding_box()["width"]
    visit.tab.locator("main button.enlarge").first.click()
    enlarged = visit.tab.locator("dialog[open] svg")
    assert enlarged.bounding_box()["width"] > width
    visit.tab.keyboard.press("Escape")
    visit.tab.wait_for_selector("dialog:not([open])", state="attached")
    assert visit.tab.locator("main .picture svg").count() == before
    visit.tab.close()
    assert visit.complaints == []


def view_of(picture: Any) -> list[float]:
    """Left, top, width and height of what is seen of a picture, in its own units."""
    return [float(one) for one in picture.get_attribute("viewBox").split()]


def test_a_figure_is_zoomed_and_moved_by_keys_wheel_and_drag(browser: Any, page_file: Path) -> None:
    visit = Visit(browser, page_file)
    tab, picture = visit.tab, visit.tab.locator("main .picture svg").first
    picture.scroll_into_view_if_needed()
    whole, box = view_of(picture), picture.bounding_box()
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    tab.mouse.move(*middle)
    before = tab.evaluate("scrollY")
    tab.mouse.wheel(0, 100)
    tab.wait_for_function("(before) => scrollY !== before", arg=before, timeout=3000)
    assert view_of(picture) == whole
    tab.mouse.click(*middle)
    assert tab.evaluate("document.activeElement.className") == "picture"
    tab.keyboard.press("+")
    by_key = view_of(picture)
    assert by_key[2] == pytest.approx(whole[2] / 1.3)
    assert by_key[0] + by_key[2] / 2 == pytest.approx(whole[2] / 2, abs=10)
    box = picture.bounding_box()
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    tab.mouse.move(*middle)
    tab.mouse.wheel(0, -300)
    tab.wait_for_function(
        "(w) => document.querySelector('.picture svg').viewBox.baseVal.width < w",
        arg=by_key[2],
        timeout=3000,
    )
    by_wheel = view_of(picture)
    tab.mouse.down()
    tab.mouse.move(middle[0] - 40, middle[1])
    tab.mouse.up()
    moved = view_of(picture)
    assert moved[0] - by_wheel[0] == pytest.approx(40 * by_wheel[2] / box["width"], rel=0.01)
    assert moved[1:] == pytest.approx(by_wheel[1:])
    tab.keyboard.press("ArrowLeft")
    assert view_of(picture)[0] < moved[0]
    picture.dblclick()
    assert view_of(picture) == whole
    tab.keyboard.press("+")
    tab.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert view_of(picture) == whole
    tab.close()
    assert visit.complaints == []


def test_a_figure_tells_the_readings_of_its_file(browser: Any, page_file: Path) -> None:
    visit = Visit(browser, page_file)
    figure = visit.tab.locator("main section.experiment figure").first
    file = str(figure.locator("figcaption a[download]").get_attribute("href"))
    table = pd.read_csv(page_file.parent / file)
    readings = table[table["series"].str.endswith(" data")][["x", "y"]].to_numpy()
    figure.locator("svg").scroll_into_view_if_needed()
    dots = figure.locator("[data-series$=' data'] > g > use")
    assert dots.count() == len(readings)
    for number in (3, len(readings) // 2):
        at = dots.nth(number).bounding_box()
        visit.tab.mouse.move(at["x"] + at["width"] / 2, at["y"] + at["height"] / 2)
        name, _, values = visit.tab.locator(".told").inner_text().partition(": ")
        assert name.endswith(" data")
        (x, x_unit), (y, y_unit) = (value.split() for value in values.split(", "))
        assert (x_unit, y_unit) == ("%", "MPa")
        spans = np.ptp(table[["x", "y"]].to_numpy(), axis=0)
        assert np.abs(readings[number] - [float(x), float(y)]) == pytest.approx(
            [0, 0], abs=2e-3 * spans.max()
        )
    figure.locator(".picture").focus()
    before = visit.tab.locator(".told").inner_text()
    visit.tab.keyboard.press(".")
    assert visit.tab.locator(".told").inner_text() != before
    visit.tab.close()
    assert visit.complaints == []


def test_a_figure_needs_no_script(browser: Any, page_file: Path) -> None:
    context = browser.new_context(java_script_enabled=False)
    tab = context.new_page()
    tab.goto(page_file.as_uri())
    picture = tab.locator("main .picture svg").first
    assert picture.bounding_box()["height"] > 100
    assert "axial strain" in picture.inner_html()
    assert tab.locator(".told, .enlarge").count() == 0
    context.close()


@pytest.mark.parametrize("width", WIDTHS)
def test_nothing_lies_over_a_figure(browser: Any, page_file: Path, width: int) -> None:
    visit = Visit(browser, page_file, width=width)
    over = visit.tab.eval_on_selector_all(
        "main figure:has(.enlarge)",
        "all => all.map((one) => [...one.querySelectorAll('.picture, .enlarge')]"
        ".map((part) => part.getBoundingClientRect()))"
        ".filter(([picture, button]) => picture.height > 0 && button.top < picture.bottom)",
    )
    visit.tab.close()
    assert over == []
    assert visit.complaints == []


@pytest.mark.parametrize("width", WIDTHS)
def test_letters_of_first_figures_can_be_read(browser: Any, page_file: Path, width: int) -> None:
    visit = Visit(browser, page_file, width=width)
    shown = visit.tab.eval_on_selector_all(
        "main section.experiment > .beside > figure svg",
        "all => all.map((one) => one.getBoundingClientRect().width / one.viewBox.baseVal.width)",
    )
    visit.tab.close()
    assert min(shown) * 10 >= 9.0  # CSS pixels that letters of 10 points have


@pytest.mark.parametrize(("width", "is_beside"), [(400, False), (1280, True)])
def test_what_is_said_of_a_figure_stands_beside_it_where_there_is_room(
    browser: Any, page_file: Path, width: int, is_beside: bool
) -> None:
    visit = Visit(browser, page_file, width=width)
    first = visit.tab.locator("section.experiment").first
    figure = first.locator(".beside > figure").bounding_box()
    said = first.locator(".beside > figure + div").bounding_box()
    visit.tab.close()
    assert (said["x"] >= figure["x"] + figure["width"]) is is_beside
    assert (said["y"] >= figure["y"] + figure["height"]) is not is_beside


@pytest.mark.parametrize("width", [1160, 1200, 1280])
def test_what_decides_numbers_of_a_fit_is_not_cut_off(
    browser: Any, page_file: Path, width: int
) -> None:
    visit = Visit(browser, page_file, width=width)
    room = visit.tab.eval_on_selector_all(
        ".beside .scroll:has(> .values)",
        "all => all.map((one) => one.clientWidth - one.scrollWidth)",
    )
    visit.tab.close()
    assert room
    assert min(room) >= 0


def test_a_folded_fit_opens_from_a_link(browser: Any, page_file: Path) -> None:
    visit = Visit(browser, page_file)
    folded = visit.tab.locator("details.variant")
    assert folded.count() == 1
    assert folded.get_attribute("open") is None
    key = folded.get_attribute("id")
    figure = folded.locator("figure").first
    assert not figure.is_visible()
    visit.tab.locator(f"#contents a[href='#{key}']").click()
    figure.wait_for(state="visible", timeout=3000)
    folded_figure = folded.locator("details > figure").first
    folded.locator("details:has(> figure) > summary").first.click()
    legend = folded_figure.locator("figcaption a").first
    explained = visit.tab.locator(f"[id='{str(legend.get_attribute('href'))[1:]}']")
    assert not explained.is_visible()
    legend.click()
    explained.wait_for(state="visible", timeout=3000)
    visit.tab.close()
    assert visit.complaints == []


def test_a_fit_takes_little_room_until_it_is_unfolded(browser: Any, page_file: Path) -> None:
    visit = Visit(browser, page_file)
    heights = visit.tab.eval_on_selector_all(
        "section.experiment:not(:has(details.variant))",
        "all => all.map((one) => one.getBoundingClientRect().height)",
    )
    words = visit.tab.eval_on_selector_all(
        "section.experiment:not(:has(details.variant))",
        "all => all.map((one) => one.innerText.replace("
        "one.querySelector('figcaption').innerText, '').split(/\\s+/).length)",
    )
    visit.tab.close()
    assert heights
    assert max(heights) < 1050  # every number of this fit is by data
    assert max(words) < 250  # beside the caption


def test_nothing_is_folded_on_paper(browser: Any, page_file: Path) -> None:
    visit = Visit(browser, page_file)
    visit.tab.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert visit.tab.locator("main details:not([open])").count() == 0
    visit.tab.evaluate("dispatchEvent(new Event('afterprint'))")
    assert visit.tab.locator("main details[open]").count() == 0
    visit.tab.close()


def test_results_can_be_copied(browser: Any, page_file: Path) -> None:
    visit = Visit(browser, page_file)
    visit.tab.evaluate(
        "() => { window.copied = []; Object.defineProperty(navigator, 'clipboard', "
        "{ value: { writeText: async (text) => { window.copied.push(text); } } }); }"
    )
    section = visit.tab.locator("section.experiment").first
    section.locator(".values tbody tr td:nth-child(4)").first.evaluate(
        "(cell) => { cell.innerText = '-0.254 ± 0.076'; }"
    )
    section.get_by_role("button", name="Copy CSV").click()
    section.get_by_role("button", name="Copy LaTeX").click()
    csv, latex = visit.tab.evaluate("window.copied")
    visit.tab.close()
    table = pd.read_csv(io.StringIO(csv), comment="#")
    assert [*table.columns] == ["symbol", "quantity", "unit", "value", "decided by"]
    assert table["value"][0] == "-0.254 ± 0.076"  # no formula
    assert {"E_M", "E_K"} <= {*table["symbol"]}
    told = "a measured one"  # by the name of the run
    assert csv.startswith(f"# {told}\n")
    assert latex.startswith(f"% {told}\n\\begin{{tabular}}{{")
    assert len({line.count("\\\\") for line in latex.splitlines() if "&" in line}) == 1
    assert "$n$ & stress exponent" in latex


def test_copies_say_what_fits_are_not_fit_for(browser: Any, page_file: Path) -> None:
    visit = Visit(browser, page_file)
    copied = visit.tab.evaluate("all('section.experiment table.results').map(asCsv)")
    visit.tab.close()
    doubted = [one.splitlines()[0] for one in copied if "not sampled well" in one]
    assert any(one.startswith("# first (synthetic data): The posterior was") for one in doubted)


@pytest.mark.parametrize("width", WIDTHS)
def test_both_answers_about_one_fit_are_on_the_first_screen(
    browser: Any, tmp_path: Path, width: int
) -> None:
    fit = make_fit(tmp_path / "run", chains=2, draws=300, divergences=5, apart=3.0)
    page = write_report([fit], tmp_path / "page", title="One", command="pyburgers report")
    visit = Visit(browser, page, width=width)
    ends = visit.tab.eval_on_selector_all(
        "#page-status li", "all => all.map((one) => one.getBoundingClientRect().bottom)"
    )
    visit.tab.close()
    assert max(ends) < 600


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [400, 1280])
def test_rules_of_accessibility_hold(
    browser: Any, page_file: Path, scheme: str, width: int
) -> None:
    script = AXE / "axe.min.js"
    if not script.is_file():
        pytest.fail(
            f"{script}: not there; npm install --prefix tests/browser axe-core, or AXE_CORE=FOLDER."
        )
    visit = Visit(browser, page_file, width=width, scheme=scheme)
    visit.tab.evaluate(script.read_text(encoding="utf-8"))
    visit.tab.evaluate("document.querySelectorAll('details').forEach((one) => one.open = true)")
    found = visit.tab.evaluate("axe.run().then((result) => result.violations)")
    visit.tab.close()
    assert [(one["id"], [node["html"][:120] for node in one["nodes"][:3]]) for one in found] == []
