"""Pages in a browser: drawn, turned and clicked without errors, on a phone too."""

from base64 import b64decode

import numpy as np
import pytest
from browser import needs_chromium, opened
from test_report import PAIR, record_of, write

from jfsf.apps.report._html import Row, write_index

pytestmark = needs_chromium


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    write(path)
    return path


@pytest.fixture(scope="module")
def desktop(report, tmp_path_factory):
    yield from opened(report, tmp_path_factory.mktemp("profile"))


@pytest.fixture(scope="module")
def phone(report, tmp_path_factory):
    yield from opened(report, tmp_path_factory.mktemp("profile"), phone=True)


def is_drawn(pixels):
    """Whether a shape in several colours stands on the plain ground."""
    body = pixels[pixels[..., 3] == 255]
    return 0.02 < len(body) / pixels[..., 3].size < 0.5 and body.std(0).max() > 20


@pytest.mark.parametrize(
    "name", ["desktop", pytest.param("phone", marks=pytest.mark.slow)]
)
def test_shapes_are_drawn_without_errors_and_nothing_is_too_wide(name, request):
    page = request.getfixturevalue(name)
    assert page.run("return document.body.dataset.ready") == "yes"
    for canvas in ("#canvas-x", "#canvas-y"):
        assert is_drawn(page.pixels(canvas))
    width = page.run("return document.documentElement.scrollWidth")
    assert width == page.run("return window.innerWidth")
    assert width == (390 if name == "phone" else 1280)
    for summary in page.all("summary"):
        summary.click()
    assert page.run("return document.documentElement.scrollWidth") == width
    assert page.errors() == []


def test_nothing_is_loaded(desktop):
    found = "return performance.getEntriesByType('resource').map((e) => e.name)"
    assert [name for name in desktop.run(found) if not name.startswith("data:")] == []


@pytest.mark.parametrize("side", ["x", "y"])
def test_a_click_marks_the_point_and_its_image(side, desktop, report):
    other = "y" if side == "x" else "x"
    before = desktop.pixels(f"#canvas-{other}")
    desktop.click(f"#canvas-{side}", 0.5, 0.42)  # the trunk
    (line,) = desktop.all("#marks li")
    source, target = line.text.split(" → ")
    assert source[0] == side.upper() and target[0] == other.upper()
    maps = record_of(report)["scene"]["maps"][0]
    T = np.frombuffer(b64decode(maps["xy" if side == "x" else "yx"]), "<u2")
    assert T[int(source[2:])] == int(target[2:])
    assert (desktop.pixels(f"#canvas-{other}") != before).any()
    desktop.one("#clear").click()
    assert desktop.all("#marks li") == []
    desktop.click(f"#canvas-{side}", 0.02, 0.02)  # beside the shape
    assert desktop.all("#marks li") == []


def test_a_tap_marks_a_point_on_the_phone(phone):
    phone.click("#canvas-x", 0.5, 0.45)
    assert len(phone.all("#marks li")) == 1


def test_both_shapes_turn_together_and_back(desktop):
    before = [desktop.pixels(f"#canvas-{side}") for side in "xy"]
    desktop.drag("#canvas-x", 120)
    for side, image in zip("xy", before, strict=True):
        assert (desktop.pixels(f"#canvas-{side}") != image).mean() > 0.01
    assert desktop.all("#marks li") == []  # a drag is no click
    desktop.one("#reset").click()
    for side, image in zip("xy", before, strict=True):
        assert (desktop.pixels(f"#canvas-{side}") != image).mean() < 0.001


def test_modes_paint_differently(desktop):
    seen = []
    for button in desktop.all("#modes button"):
        button.click()
        assert button.get_attribute("aria-pressed") == "true"
        shown = desktop.one("#scale").is_displayed()
        assert shown == (button.text in ("Error", "There and back", "Doubt"))
        seen.append(desktop.pixels("#canvas-x"))
    assert len(seen) == 5
    for i, one in enumerate(seen):
        for other in seen[:i]:
            assert (one != other).mean() > 0.005
    desktop.one("#modes button").click()


def test_a_candidate_is_shown_when_chosen(desktop):
    before = desktop.pixels("#canvas-x")
    found, *candidates = desktop.all("#candidates button")
    candidates[-1].click()
    assert desktop.one("#map").get_attribute("value") == f"candidate {len(candidates)}"
    assert (desktop.pixels("#canvas-x") != before).mean() > 0.01
    found.click()
    assert (desktop.pixels("#canvas-x") != before).mean() < 0.001


def test_texts_are_there(desktop):
    assert desktop.one("h1").text == f"{PAIR[0]} → {PAIR[1]}"
    assert "right" in desktop.one("#verdict").text
    assert desktop.all("#reasons li") and desktop.all("#truth tr")
    assert all(
        desktop.run("return [...document.images].map((i) => i.naturalWidth > 0)")
    )


def test_without_webgl_a_picture_stands_in(report, tmp_path):
    flags = ("--disable-3d-apis",)
    for page in opened(report, tmp_path / "profile", flags=flags):
        assert page.all("canvas") == [] and "no WebGL" in page.one("#hint").text
        wide = page.run("return document.querySelector('.panes img').naturalWidth")
        assert wide > 200 and len(page.all("#candidates img")) == 2


def test_names_of_files_are_text(tmp_path):
    name = "<img src=x onerror=alert(1)></script>{{style}}"
    path = tmp_path / "index.html"
    row = Row(name, None, None, 0.5, [name])
    write_index(path, [row])
    for page in opened(path, tmp_path / "profile"):
        assert page.one("#pairs span").text == name
        assert page.all("img") == [] and page.errors() == []


@pytest.mark.slow
def test_index_lists_links_and_filters(tmp_path, report):
    (tmp_path / "a.html").write_text("<title>a</title>")
    rows = [
        Row("cat → dog", "a.html", None, 0.95, []),
        Row("cat → bad", None, None, float("nan"), ["has no faces"], failed=True),
        Row("man → ape", "a.html", None, 0.1, ["look at it"]),
    ]
    write_index(tmp_path / "index.html", rows)
    for phone in (False, True):
        profile = tmp_path / f"profile{phone}"
        for page in opened(tmp_path / "index.html", profile, phone):
            chips = [chip.text for chip in page.all(".chip")]
            assert chips == ["failed", "probably wrong, 10%", "very likely right, 95%"]
            assert page.one("#counts").text == "3 pairs, 2 matched, 1 failed"
            assert len(page.all("#pairs a")) == 2
            page.one("#filter").send_keys("man")
            shown = [row for row in page.all("#pairs li") if row.is_displayed()]
            assert len(shown) == 1 and "look at it" in shown[0].text
            width = page.run("return document.documentElement.scrollWidth")
            assert width == page.run("return window.innerWidth")
            assert page.errors() == []
