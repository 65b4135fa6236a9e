"""The manual: pdoc builds it without a warning, and its links lead somewhere."""

import subprocess
import sys
from html.parser import HTMLParser
from urllib.parse import unquote, urlparse

import pytest
from documents import GUIDES

import jfsf

# jaxopt warns of its own end when it is imported.
WARNINGS = "-Werror", "-Wignore:JAXopt is no longer:DeprecationWarning"


class Page(HTMLParser):
    """The links and anchors of a page."""

    def __init__(self, text):
        super().__init__()
        self.links, self.ids = [], set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.ids |= {given[key] for key in ("id", "name") if given.get(key)}
        if tag == "a" and given.get("href"):
            self.links.append(given["href"])


@pytest.fixture(scope="module")
def manual(tmp_path_factory):
    folder = tmp_path_factory.mktemp("manual")
    command = [sys.executable, *WARNINGS, "-m", "jfsf.apps.guide", folder]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return {p.relative_to(folder): p.read_text() for p in folder.rglob("*.html")}


def test_every_part_and_guide_has_a_page(manual):
    names = {path.with_suffix("").as_posix() for path in manual}
    assert {f"jfsf/apps/guide/{guide.stem}" for guide in GUIDES} <= names
    assert {f"jfsf/{part}" for part in jfsf._ROOMS} <= names


def test_guides_are_in_their_pages(manual):
    for guide in GUIDES:
        (html,) = (
            t for p, t in manual.items() if p.stem == guide.stem and "guide" in p.parts
        )
        title = guide.read_text().splitlines()[0].removeprefix("# ")
        assert f">{title}</h1>" in html
        assert "<p>.. include" not in html


def test_formulas_are_drawn(manual):
    (method,) = (text for path, text in manual.items() if path.stem == "method")
    assert "MathJax" in method
    assert r"$$K_{ij} = e^{-\lambda d_{ij} / \ell}" in method  # as it was written


def test_links_lead_somewhere(manual):
    pages = {path: Page(text) for path, text in manual.items()}
    wrong = []
    for path, page in pages.items():
        for link in page.links:
            url = urlparse(link)
            if url.scheme:
                continue
            target = path
            if url.path:
                parts = []
                for part in (path.parent / unquote(url.path)).parts:
                    parts = parts[:-1] if part == ".." else [*parts, part]
                target = type(path)(*parts)
            anchors = pages[target].ids if target in pages else set()
            if target not in pages or (url.fragment and url.fragment not in anchors):
                wrong.append(f"{path}: {link}")
    assert not wrong


def test_fields_of_records_are_a_list(manual):
    (types,) = (text for path, text in manual.items() if path.stem == "types")
    field = '<code><a href="#Spectrum.evals">evals</a></code>'
    assert f"<li><strong>{field}</strong>: ascending" in types
