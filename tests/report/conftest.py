"""A browser for the tests of pages, and pages opened in it that note what they say and request."""

import shutil

import pytest
from page_rows import DRAWN, Rows

from nsbench import write_report

BROWSER = shutil.which("chromium") or shutil.which("google-chrome")


@pytest.fixture(scope="module")
def browser():
    """One browser for all tests of a module."""
    if BROWSER is None:
        pytest.skip("no chromium on this machine")
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield started
        started.close()


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """The page of a study of a few cases and methods, as an address."""
    return write_report(Rows, tmp_path_factory.mktemp("page") / "report.html").as_uri()


@pytest.fixture
def open_page(browser, file):
    """Open a page, by default the module's `file`, with the given settings of its context."""
    contexts = []

    def opened(address=file, **settings):
        context = browser.new_context(viewport={"width": 1200, "height": 900}, **settings)
        contexts.append(context)
        page = context.new_page()
        page.said = []
        page.requests = []
        page.on("console", lambda message: page.said.append(message.text))
        page.on("pageerror", lambda error: page.said.append(str(error)))
        page.on("request", lambda request: page.requests.append(request.url))
        page.goto(address)
        return page

    yield opened
    for context in contexts:
        context.close()


@pytest.fixture
def page(open_page):
    """The page with its first chart drawn."""
    opened = open_page()
    opened.wait_for_selector(DRAWN)
    return opened
