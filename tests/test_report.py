"""Reports: what a page holds, how small it is, and the confidence in words."""

import json
import re
from base64 import b64decode
from unittest import mock
from urllib.parse import unquote, urljoin, urlsplit

import numpy as np
import pytest
from certificates import GOOD, with_figures
from scipy.spatial import KDTree
from shapes import small

from jfsf._figures import FIGURES
from jfsf.apps.plot._colours import body_colours, matched_colours
from jfsf.apps.plot._frames import frames_of_pair
from jfsf.apps.report import Side, findings, reasons, write_report
from jfsf.apps.report._candidates import CandidateMap, candidate_maps, maps_of
from jfsf.apps.report._html import Row, thumbnail, write_index
from jfsf.apps.report._measured import measure
from jfsf.apps.report._scene import scene, shown, shown_maps
from jfsf.apps.report._words import in_short, readings, verdict, warnings_of
from jfsf.data import Sample, load
from jfsf.initial import Candidates
from jfsf.types import STAGES, Maps, Match, MatchInfo, Mesh

PAIR = ("man_walk", "man_up")
PLAIN = np.eye(3)


def true_map(x, y):
    """T_xy by the ground truth: of the nearest vertex of X that has one."""
    first = np.full(len(x.mesh.vertices), -1)
    first[x.template_to_vertex] = y.template_to_vertex
    known = np.flatnonzero(first >= 0)
    near = KDTree(x.mesh.vertices[known]).query(x.mesh.vertices)[1]
    return first[known[near]].astype(np.int32)


def pair():
    """Two embedded shapes, and a match that is the ground truth."""
    x, y = map(load, PAIR)
    maps = true_map(x, y), true_map(y, x)
    likely = {
        f"confidence_{side}": np.linspace(0.5, 1, len(own.mesh.vertices))
        for side, own in (("x", x), ("y", y))
    }
    return x, y, Match(*maps, np.eye(40), GOOD, **likely)


def write(path, **options):
    """A report of the pair, whose candidates are two and were not searched."""
    x, y, found = pair()

    def two(mesh_x, mesh_y, at, **_):
        straight = true_map(x, y), true_map(y, x)
        mirrored = [
            KDTree(side.mesh.vertices * [-1, 1, 1]).query(side.mesh.vertices)[1]
            for side in (x, y)
        ]
        back = Maps(straight[0][mirrored[0]], straight[1][mirrored[1]])
        both = ((Maps(*straight), 0.3, 0.9), (back, 0.5, -0.9))
        few_x, few_y = (
            shown(side.mesh, PLAIN)._replace(
                index=rows,
                near=KDTree(side.mesh.vertices[rows]).query(side.mesh.vertices)[1],
            )
            for side, rows in zip((x, y), at, strict=True)
        )
        return [CandidateMap(shown_maps(m, few_x, few_y), e, s) for m, e, s in both]

    truth = x.template_to_vertex, y.template_to_vertex
    sides = Side(x.mesh, PAIR[0]), Side(y.mesh, PAIR[1])
    options = {"truth": truth, "cache": False} | options
    with mock.patch("jfsf.apps.report._page.candidate_maps", two):
        return write_report(path, *sides, found, **options)


def record_of(path):
    """What the script of a page reads."""
    found = re.search(r'id="record">(.*?)</script>', path.read_text(), re.DOTALL)
    assert found
    return json.loads(found[1])


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    picture = write(folder / "a.html", seconds={"matching": 1.5})
    thumbnail(picture, folder / "a.png")
    assert sorted(p.name for p in folder.iterdir()) == ["a.html", "a.png"]
    return folder / "a.html"


def unpacked(text, dtype):
    return np.frombuffer(b64decode(text), dtype)


def test_page_is_small_and_needs_no_network(page):
    assert page.stat().st_size < 2_500_000
    text = page.read_text()
    assert "The MIT License" in text and "three.js authors" in text
    outside = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    assert not re.findall(r'(?:src|href)="(?!data:)', outside)
    assert "{{" not in outside
    assert (page.parent / "a.png").read_bytes().startswith(b"\x89PNG")


def test_page_has_the_shapes_and_the_maps(page):
    x, y, found = pair()
    record = record_of(page)
    parts, names = record["scene"], [m["name"] for m in record["scene"]["maps"]]
    assert parts["x"]["colours"] is None  # by the map, from those of Y
    assert names == ["the map found", "candidate 1", "candidate 2"]
    assert np.array_equal(unpacked(parts["maps"][0]["xy"], "<u2"), found.T_xy)
    assert np.array_equal(unpacked(parts["maps"][0]["yx"], "<u2"), found.T_yx)
    assert np.array_equal(unpacked(parts["maps"][1]["xy"], "<u2"), found.T_xy)
    faces = unpacked(parts["x"]["faces"], "<u2").reshape(-1, 3)
    assert np.array_equal(faces, x.mesh.faces) and parts["x"]["numbers"] is None
    points = unpacked(parts["x"]["points"], "<u2").reshape(-1, 3) / 65535
    points = points + parts["x"]["low"]
    # The same shape, up to rotation and scale.
    sample = np.arange(0, len(points), 97)
    shape = x.mesh.vertices[sample]
    apart, true = (
        np.linalg.norm(p[:, None] - p[None], axis=2) for p in (points[sample], shape)
    )
    assert np.allclose(apart / apart.max(), true / true.max(), atol=1e-3)
    assert np.ptp(points, axis=0).max() == pytest.approx(1, abs=1e-4)
    # Upright: the head is above the feet, as in the file.
    assert np.corrcoef(points[:, 1], x.mesh.vertices[:, 1])[0, 1] > 0.98


def test_page_says_how_sure_and_what_was_measured(page):
    record = record_of(page)
    assert record["verdict"]["level"] == "good"
    assert record["verdict"]["words"] == "very likely right"
    assert record["findings"] == [] and len(record["reasons"]) == 6
    assert {row[0] for row in record["certificate"]} == {
        name.replace("_", " ") for name in FIGURES
    }
    assert [f["name"] for f in record["scene"]["figures"]] == [
        "error",
        "there and back",
        "doubt",
    ]
    likely = pair()[2].confidence_x
    doubt = record["scene"]["figures"][2]
    steps = np.clip((1 - likely) / doubt["top"], 0, 1) * 254
    assert np.array_equal(unpacked(doubt["steps"], "u1"), np.rint(steps))
    truth = {name: value for name, value, _ in record["truth"]}
    assert float(truth["mean error"]) < 0.01
    assert re.search(r"in its unit, \d+\.\d+% of its rms size", record["truth"][0][2])
    assert float(truth["expected"].rstrip("%")) == pytest.approx(75, abs=3)
    assert record["seconds"] == {"matching": 1.5}
    assert record["settings"]["k"] == 128 and "jax" in record["versions"]
    first, second = record["candidates"]
    assert first["nearest"] and not second["nearest"]
    assert second["orientation"] < 0 and second["picture"] != first["picture"]


def test_page_without_ground_truth_or_known_figures(tmp_path):
    nothing = with_figures(GOOD, confidence=np.nan, gap=np.inf, orientation=np.nan)
    x, y, found = pair()
    with mock.patch("jfsf.apps.report._page.candidate_maps", lambda *_, **__: []):
        write_report(
            tmp_path / "a.html",
            Side(x.mesh, "X", np.arange(len(x.mesh.vertices)) + 3),
            Side(y.mesh, "Y"),
            found._replace(certificate=nothing, confidence_x=None),
            up="y",
        )
    record = record_of(tmp_path / "a.html")
    assert record["verdict"]["confidence"] is None and record["truth"] == []
    assert record["verdict"]["level"] == "unknown" and record["candidates"] == []
    assert "errors" not in record["pictures"]
    names = [figure["name"] for figure in record["scene"]["figures"]]
    assert names == ["there and back"]
    numbers = unpacked(record["scene"]["x"]["numbers"], "<u4")
    assert numbers[0] == 3 and len(numbers) == len(x.mesh.vertices)


def test_large_shapes_are_shown_by_some_of_their_vertices():
    x, y, found = pair()
    some_x, some_y = shown(x.mesh, PLAIN, 800), shown(y.mesh, PLAIN, 5000)
    assert len(some_x.index) <= 800 and len(some_y.index) <= 5000
    maps = shown_maps(found, some_x, some_y)
    assert len(maps.T_xy) == len(some_x.index) and len(maps.T_yx) == len(some_y.index)
    true = y.mesh.vertices[np.asarray(found.T_xy)[some_x.index]]
    seen = y.mesh.vertices[some_y.index][maps.T_xy]
    assert np.linalg.norm(true - seen, axis=1).max() < 0.05
    figures = {"error": np.r_[np.nan, np.full(len(some_x.index) - 1, 0.02)]}
    parts = scene(some_x, some_y, {"m": maps}, figures, (None, None))
    assert np.array_equal(unpacked(parts["x"]["numbers"], "<u4"), some_x.index)
    (figure,) = parts["figures"]
    steps = unpacked(figure["steps"], "u1")
    # The scale of small errors does not end at the largest of them.
    assert figure["top"] == 0.05 and steps[0] == 255
    assert (steps[1:] == round(254 * 0.02 / 0.05)).all()


def test_clouds_and_many_vertices_have_wide_indices():
    cloud = Mesh(np.random.default_rng(0).random((70_000, 3)), np.zeros((0, 3), int))
    whole = shown(cloud, PLAIN, 80_000)
    maps = Maps(np.arange(70_000), np.arange(70_000))
    parts = scene(whole, whole, {"m": maps}, {}, (None, None))
    assert parts["x"]["faces"] == "" and parts["x"]["n"] == 70_000
    assert np.array_equal(unpacked(parts["maps"][0]["xy"], "<u4"), maps.T_xy)


def test_measured_figures_are_those_of_the_metrics():
    x, y, found = pair()
    truth = x.template_to_vertex, y.template_to_vertex
    right = measure(x.mesh, y.mesh, found, truth)
    wrong = measure(x.mesh, y.mesh, found._replace(T_xy=found.T_xy[::-1]), truth)
    assert right.errors is not None and wrong.errors is not None
    assert right.errors.mean() < 0.01 < 0.2 < wrong.errors.mean()
    assert right.back is not None and wrong.back is not None
    assert right.back.mean() < 0.02 < 0.2 < wrong.back.mean()
    assert len(right.back) == len(x.mesh.vertices)
    assert measure(x.mesh, y.mesh, found).truth_rows == []
    assert measure(x.mesh, y.mesh, found, ([], [])).truth_rows == []
    short = truth[0], truth[1][:-1]
    for unequal in (short, (truth[0][:-1], truth[1])):
        with pytest.raises(ValueError, match=r"give \(p,\) of each"):
            measure(x.mesh, y.mesh, found, unequal)


def test_a_page_of_sides_that_do_not_fit_is_an_error(tmp_path):
    x, y, found = pair()
    with pytest.raises(ValueError, match="write_report: T_xy .* the other way"):
        write_report(tmp_path / "a.html", Side(y.mesh, "y"), Side(x.mesh, "x"), found)
    assert not list(tmp_path.iterdir())


def test_a_page_of_parts_is_grey_where_nothing_is_matched(tmp_path):
    x, y, found = pair()
    inside = [own > np.median(own) for own in (s.mesh.vertices[:, 1] for s in (x, y))]
    part = found._replace(
        certificate=of_parts(0.3, log_odds=-1.5),
        matched_x=inside[0],
        matched_y=inside[1],
        membership_x=np.where(inside[0], 0.9, 0.1),
        confidence_x=None,
        confidence_y=None,
    )
    sides = Side(x.mesh, "X"), Side(y.mesh, "Y")
    write_report(tmp_path / "a.html", *sides, part, cache=False)
    record = record_of(tmp_path / "a.html")
    axes_y = frames_of_pair(x.mesh, y.mesh, found.T_xy, matched_x=inside[0])[1]
    colours = body_colours(shown(y.mesh, axes_y).body.vertices)
    greys = [matched_colours(colours[found.T_xy], inside[0])]
    greys += [matched_colours(colours, inside[1])]
    for side, wanted in zip("xy", greys, strict=True):
        packed = unpacked(record["scene"][side]["colours"], "u1").reshape(-1, 3)
        assert np.array_equal(packed, np.rint(255 * wanted))
    back, outside = record["scene"]["figures"]
    assert outside["name"] == "not shared" and 0.85 < outside["top"] < 0.95
    assert np.array_equal(unpacked(back["steps"], "u1") < 255, inside[0])
    rows = {name: value for name, value, _ in record["figures"]}
    assert 30 < float(rows["matched of X"][:-1]) < 70 and "matched of Y" in rows
    assert "region is probably wrong" in record["findings"][0]["why"]
    said = " ".join(record["reasons"])
    assert "between the regions (-1.50)" in said and "candidate" not in said
    assert "cost -18.5" in said


def of_parts(confidence, **others):
    """The certificate of a region that two parts share."""
    return with_figures(GOOD, confidence=confidence, region_cost=-18.5, **others)


@pytest.mark.parametrize(
    ("likely", "words"),
    [(0.2, "probably wrong"), (0.65, "doubtful"), (0.75, None), (0.95, None)],
)
def test_a_region_is_doubted_by_its_confidence(likely, words):
    said = warnings_of(of_parts(likely), "preserve")
    assert len(said) == (words is not None)
    # Ends of a body may lie outside of it.
    assert words is None or said[0].startswith(
        f"the region is {words}, confidence {likely:.0%}"
    )
    assert "hands" not in " ".join(said)
    reading = readings(of_parts(likely))
    assert reading["confidence"][1] == verdict(likely)
    assert "next region" in reading["gap"][1]
    why = " ".join(reasons(of_parts(likely)))
    assert "0.93 beyond those of the next region" in why


def test_a_region_without_a_confidence_is_to_be_looked_at():
    (said,) = warnings_of(of_parts(np.nan), "preserve")
    assert "not known where units may differ" in said
    assert "parts in one unit" in " ".join(reasons(of_parts(np.nan)))


@pytest.mark.slow
def test_pages_without_times_are_equal(tmp_path):
    texts = []
    for name in "ab":
        write(tmp_path / name, seconds={"matching": 1.5}, timed=False)
        texts.append((tmp_path / name).read_bytes())
        record = record_of(tmp_path / name)
        assert record["seconds"] == {} and "date" not in record["versions"]
    assert texts[0] == texts[1]


@pytest.mark.slow
def test_old_pages_stay_when_the_disk_is_full(tmp_path, monkeypatch):
    def fail(path, text):
        raise OSError("disk full")

    (tmp_path / "a.html").write_text("old")
    monkeypatch.setattr("jfsf.apps.report._page.write_text", fail)
    with pytest.raises(OSError, match="disk full"):
        write(tmp_path / "a.html")
    assert [p.read_text() for p in tmp_path.iterdir()] == ["old"]


def test_index_puts_failed_and_doubtful_pairs_first(tmp_path):
    rows = [
        Row("a", "a.html", "a.png", 0.9, []),
        Row("c", "c.html", "c.png", 0.2, ["doubtful"]),
        Row("e", None, None, np.nan, ["no file"], failed=True),
        Row("g", "g.html", "g.png", np.nan, []),
    ]
    write_index(tmp_path / "index.html", rows)
    listed = record_of(tmp_path / "index.html")["rows"]
    assert [row["name"] for row in listed] == ["e", "c", "a", "g"]
    assert [row["level"] for row in listed] == ["failed", "poor", "good", "unknown"]


def test_links_hold_what_names_hold(tmp_path):
    name = "report/a#1?%41 ü"
    row = Row("a", f"{name}.html", f"{name}.png", 0.9, [])
    write_index(tmp_path / "index.html", [row])
    (listed,) = record_of(tmp_path / "index.html")["rows"]
    for found in (listed["page"], listed["picture"]):
        parts = urlsplit(urljoin("file:///x/index.html", found))
        assert unquote(parts.path).startswith(f"/x/{name}.")
        assert not parts.query and not parts.fragment


def test_names_that_the_locale_does_not_hold_do_no_harm(tmp_path):
    name = "größe".encode().decode("ascii", "surrogateescape")
    write_index(
        path := tmp_path / "index.html", [Row(f"{name} 头", None, None, 1.0, [])]
    )
    text = path.read_bytes().decode("utf-8")
    assert "größe" in text and "头" in text


def test_candidates_have_maps_but_for_copies():
    rng = np.random.default_rng(0)
    evecs = np.linalg.qr(rng.normal(size=(40, 5)))[0]
    flip = np.diag([1.0, 1, -1])
    best = Candidates(
        np.stack([np.eye(3), flip, flip]),
        np.array([0.1, 0.3, np.inf]),  # the last is a copy
        np.array([0.9, -0.9, -0.9]),
        np.array(2.0),
    )
    one, two = maps_of(best, evecs, evecs)
    np.testing.assert_array_equal(one.maps.T_xy, np.arange(40))
    assert (two.maps.T_xy != np.arange(40)).any()
    assert (two.energy, two.orientation) == (0.3, -0.9)


@pytest.mark.slow
@pytest.mark.usefixtures("run_once")
def test_candidates_of_the_search_hold_the_right_map():
    x, y = (Sample(*small(name, 1100)) for name in PAIR)
    at = np.arange(0, len(x.mesh.vertices), 3), np.arange(0, len(y.mesh.vertices), 2)
    tried = candidate_maps(x.mesh, y.mesh, at, cache=False)
    assert 2 <= len(tried) <= 6
    assert [one.energy for one in tried] == sorted(one.energy for one in tried)
    points, true = y.mesh.vertices, true_map(x, y)[at[0]]
    away = [
        np.linalg.norm(points[at[1]][one.maps.T_xy] - points[true], axis=1)
        for one in tried
    ]
    means = [distance.mean() for distance in away]
    assert min(means) < 0.12  # metres, of people 1.8 m tall
    assert means[0] == min(means) and max(means) > 0.3
    for T, n in zip(tried[0].maps, (len(at[1]), len(at[0])), strict=True):
        assert 0 <= T.min() <= T.max() < n


def test_words_say_what_is_known():
    assert warnings_of(GOOD, "preserve") == [] == findings(GOOD, "preserve")
    poor = with_figures(GOOD, confidence=0.1, orientation=-0.9)
    why = [finding.why for finding in findings(poor, "preserve")]
    assert why == warnings_of(poor, "preserve") and len(why) == 2
    assert "swapped" in why[0] and "probably wrong, confidence 10%" in why[1]
    assert all("--landmarks" in f.advice for f in findings(poor, "preserve"))
    assert readings(poor)["orientation"] == ("-0.90", "swaps left and right")
    assert "swaps left and right" in reasons(poor)[0]
    assert "unclear" in reasons(with_figures(GOOD, orientation=0.2))[0]
    unsure = with_figures(GOOD, gap=0.05, confidence=0.8)
    assert "gap 5%" in reasons(unsure)[-1]
    # What is very likely right all the same need not be doubted for it.
    sure = with_figures(unsure, confidence=0.95)
    assert not any("gap" in said for said in reasons(sure))
    lines = in_short(sure, "preserve")
    assert lines[0] == "very likely right, confidence 95%" and len(lines) == 3
    assert lines[1].startswith("why: left and right are kept; ")
    assert lines[2].startswith("to do: nothing; --verbose")
    lines = in_short(poor, "preserve")
    assert lines[0] == "probably wrong, confidence 10%" and "swapped" in lines[1]
    assert "--landmarks" in lines[2]
    (missing,) = findings(with_figures(GOOD, recall=0.88), "preserve")
    assert "found 88% of the nearest neighbours" in missing.why
    rival = with_figures(GOOD, share=0.45)
    (better,) = findings(rival, "preserve")
    assert "another map that differs fits as well or better (share 45%)" in better.why
    assert "jfsf.alternatives" in better.advice
    several = with_figures(rival, rivals=2.0)
    (tie,) = findings(several, "preserve")
    assert "several maps fit equally well: 3 that differ were found" in tie.why
    assert "one of 3 maps that fit equally well" in " ".join(reasons(several))
    mirrored = with_figures(GOOD, mirrored=0.97)
    for asked, other, side in (("preserve", "reverse", 1), ("reverse", "preserve", -1)):
        turned = mirrored._replace(orientation=side * GOOD.orientation)
        (turn,) = findings(turned, asked)
        assert turn.why == (
            "the mirror image fits far better; is one of them mirrored? try "
            f"--orientation {other}"
        )
    assert "right map with a probability of 97%" in " ".join(reasons(mirrored))
    (kinds,) = findings(with_figures(GOOD, spectrum_gap=1.5), "preserve")
    assert "different kinds" in kinds.why and "factor of 4.5" in kinds.why
    said = {
        share: " ".join(reasons(with_figures(GOOD, share=share)))
        for share in (0.45, 0.6, 0.95, np.nan)
    }
    assert "fits as well or better (share 45%)" in said[0.45]
    assert "fits nearly as well (share 60%)" in said[0.6]
    assert "none fits nearly as well (share 95%)" in said[0.95]
    assert "share" not in said[np.nan]
    part = " ".join(reasons(with_figures(GOOD, confidence=np.nan)))
    assert "no confidence" in part and "read from" not in part
    assert all(meaning for _, meaning in readings(GOOD).values())
    words = [verdict(c) for c in (np.nan, 0.95, 0.8, 0.6, 0.2)]
    assert words[0].startswith("unknown") and len(set(words)) == 5


def test_the_attempts_are_said_in_a_sentence():
    none = np.full(len(STAGES), np.nan)
    one = MatchInfo(np.array([1]), np.array([0.97]), np.array(0), none)
    assert reasons(GOOD, one)[-1] == "One start was attempted (search)."
    two = MatchInfo(np.array([1, 3]), np.array([0.2, 0.8]), np.array(1), none)
    assert reasons(GOOD, two)[-1] == (
        "2 starts were attempted (search 0.20, coarse copies 0.80); number 2 was kept."
    )
