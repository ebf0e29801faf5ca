"""The built site: it asks no other place for anything, its files are there, and its views play in its pages."""

import html
import re
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

from tests.support.browser import needs_chromium
from tests.support.pages import elements

ROOT = Path(__file__).parents[2]
SITE = ROOT / "site"
# From a phone's to a large screen's, and those at which the theme moves its columns.
WIDTHS = (360, 414, 600, 736, 768, 900, 1024, 1180, 1320, 1366, 1430, 1500, 1556, 1700, 1920)
# What a page loads by itself. An `a` is followed by the reader.
LOADED = {"script": "src", "img": "src", "iframe": "src", "link": "href", "source": "src"}

pytestmark = pytest.mark.skipif(
    not (SITE / "index.html").exists(), reason="the site is not built: sphinx-build -W docs site"
)


def pages():
    return [page for page in sorted(SITE.rglob("*.html")) if "shown" not in page.parts]


def test_pages_load_nothing_from_elsewhere_and_what_they_load_is_there():
    for page in pages():
        for tag, attributes in elements(page.read_text())[0]:
            address = urlsplit(attributes.get(LOADED.get(tag, ""), "") or "")
            if tag == "link" and attributes.get("rel") in ("index", "search", "next", "prev"):
                continue
            assert not address.scheme + address.netloc, f"{page.name} loads {address.geturl()}"
            if address.path:
                assert (page.parent / unquote(address.path)).exists(), f"{page.name} lacks {address.path}"


def test_pictures_say_what_is_seen_in_them():
    for page in pages():
        for tag, attributes in elements(page.read_text())[0]:
            if tag == "img" and "_static" not in attributes["src"]:  # where the icons of the theme are
                assert len((attributes.get("alt") or "").split()) > 3, f"{page.name}: {attributes.get('src')}"


def test_style_sheets_load_nothing_from_elsewhere():
    for sheet in SITE.rglob("*.css"):
        text = sheet.read_text()
        assert not re.search(r"url\([\"']?(https?:)?//|@import", text), sheet


@pytest.mark.parametrize(
    "path",
    [*sorted((ROOT / "src/jaxball/files/scenario/builtin").glob("*.toml")), *sorted((ROOT / "examples").glob("*.*"))],
    ids=lambda path: path.stem,
)
def test_the_gallery_has_every_scenario_and_example_with_its_file(path):
    name = path.stem
    if path.parent.name == "examples":
        name = "example-" + re.sub(r"^\d+_", "", name).replace("_", "-")
    shown = html.unescape(re.sub(r"<[^>]*>", "", (SITE / "gallery" / f"{name}.html").read_text()))
    # A built-in file is shown without the first line, which tells editors where its schema lies beside it.
    assert re.sub(r"\A#:schema .*\n", "", path.read_text()).strip() in shown


@needs_chromium
def test_the_first_page_opens_as_a_file_and_its_view_plays(browser):
    browser.get((SITE / "index.html").as_uri())
    browser.switch_to.frame(browser.find_element(By.CSS_SELECTOR, "iframe.view"))
    WebDriverWait(browser, 30).until(lambda page: page.execute_script("return Boolean(window.jaxball)"))
    browser.execute_script("jaxball.goTo(5.0)")
    assert browser.execute_script("return jaxball.time()") == pytest.approx(5.0, abs=1e-6)
    browser.switch_to.default_content()
    assert [message for message in browser.get_log("browser") if message["level"] == "SEVERE"] == []


def resized(browser, width, height=900):
    """The inner size of the window, which on a screen cannot be made as narrow as that of a phone."""
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False},
    )


@pytest.fixture
def sized(browser):
    """A browser whose size is its own again afterwards."""
    yield browser
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    browser.execute_cdp_cmd("Network.setBlockedURLs", {"urls": []})


@needs_chromium
def test_no_page_scrolls_sideways_at_any_width(sized):
    """Neither the window nor the column of text, in which a theme may hide what is too wide."""
    sized.execute_cdp_cmd("Network.enable", {})
    sized.execute_cdp_cmd("Network.setBlockedURLs", {"urls": ["*/shown/*.html"]})
    wide = []
    for page in pages():
        sized.get(page.as_uri())
        for width in WIDTHS:
            resized(sized, width)
            for element in ("document.documentElement", "document.querySelector('.content')"):
                over = sized.execute_script(f"const e = {element}; return e ? e.scrollWidth - e.clientWidth : 0")
                if over > 0:
                    wide.append(f"{page.relative_to(SITE)} at {width}: {element} is {over} too wide")
    assert wide == []


@needs_chromium
def test_no_code_scrolls_sideways_on_a_screen(sized):
    """Its letters become smaller, and then its lines go on below; on a phone it scrolls."""
    sized.execute_cdp_cmd("Network.enable", {})
    sized.execute_cdp_cmd("Network.setBlockedURLs", {"urls": ["*/shown/*.html"]})
    too_wide = "return [...document.querySelectorAll('article pre')].filter(e => e.scrollWidth > e.clientWidth).length"
    wide, blocks = [], 0
    for page in pages():
        sized.get(page.as_uri())
        blocks += sized.execute_script("return document.querySelectorAll('article pre').length")
        for width in (768, 1024, 1366):
            resized(sized, width)
            if count := sized.execute_script(too_wide):
                wide.append(f"{page.relative_to(SITE)} at {width}: {count} blocks of code are too wide")
    assert wide == []
    assert blocks > 500


@needs_chromium
@pytest.mark.parametrize("width", [360, 768, 1366, 1920])
def test_a_view_is_whole_in_its_frame(sized, width):
    """All of it on a screen; on a phone, where graphs stand one below the other, what is moved and what moves it."""
    sized.get((SITE / "start.html").as_uri())
    resized(sized, width)
    frame = sized.find_element(By.CSS_SELECTOR, "iframe.view")
    sized.execute_script("arguments[0].scrollIntoView()", frame)
    sized.switch_to.frame(frame)
    WebDriverWait(sized, 30).until(lambda page: page.execute_script("return Boolean(window.jaxball)"))
    across, down, lowest = sized.execute_script(
        "const page = document.documentElement;"
        "const controls = document.querySelector('input[type=range]').getBoundingClientRect();"
        "return [page.scrollWidth - page.clientWidth, page.scrollHeight - page.clientHeight,"
        " controls.bottom - page.clientHeight]"
    )
    assert across <= 0
    assert lowest <= 0
    if width > 1000:
        assert down <= 0


@needs_chromium
def test_the_search_finds_a_word_without_a_network(browser):
    browser.get((SITE / "search.html").as_uri() + "?q=versor")
    found = WebDriverWait(browser, 30).until(lambda page: page.find_elements(By.CSS_SELECTOR, "#search-results li a"))
    assert any("conventions" in link.get_attribute("href") for link in found)
    assert [message for message in browser.get_log("browser") if message["level"] == "SEVERE"] == []
