"""What the guard says of maps before and after a change, and that its runs go on."""

import json

import numpy as np
import pytest

from experiments.accuracy import datasets, guard
from jfsf import testing
from jfsf.evaluate import geodesic_error

NAN = float("nan")


def row(x, error, confidence=0.95, *, name="faust_r", again=(), limit=0.1):
    own = {"set": name, "x": x, "y": "y", "role": "fit", "error": error, "seconds": 1.0}
    return own | {"confidence": confidence, "limit": limit, "again": list(again)}


def said(before, now):
    tables = ({(r["set"], r["x"], r["y"]): r for r in rows} for rows in (before, now))
    lines, worse = guard.compared(*tables)
    return "\n".join(lines), worse


def test_maps_that_are_lost_are_named():
    before = [row("a", 0.02), row("b", 0.02), row("c", 0.3, 0.2)]
    now = [row("a", 0.02), row("b", 0.56, 0.4), row("c", 0.05, 0.97)]
    text, worse = said(before, now)
    assert worse
    assert (
        "right to wrong: faust_r b y: 0.020 -> 0.560, confidence 0.95 -> 0.40" in text
    )
    assert "now right: faust_r c y" in text
    assert "sure and wrong" not in text and "faust_r a y" not in text


def test_maps_that_become_sure_and_wrong_are_named():
    before = [row("a", 0.3, 0.5), row("b", 0.3, 0.95), row("c", 0.3, NAN)]
    now = [row("a", 0.3, 0.93), row("b", 0.3, 0.95), row("c", 0.3, NAN)]
    text, worse = said(before, now)
    assert worse and text.count("sure and wrong") == 1
    assert "sure and wrong: faust_r a y: 0.300 -> 0.300" in text
    assert "of 2 maps with 0.9 or more 2 are wrong" in text


def test_a_set_says_when_its_maps_are_right():
    before = [row("a", 0.12, limit=0.2)]
    text, worse = said(before, [row("a", 0.15, limit=0.2)])
    assert "right to wrong" not in text
    assert said(before, [row("a", 0.25, limit=0.2)])[0].startswith("right to wrong")


@pytest.mark.parametrize(
    ("change", "beyond", "worse"),
    [(0, False, False), (0.005, False, False), (0.007, True, True)]
    + [(-0.005, False, False), (-0.007, True, False)],
)
def test_a_median_moves_by_more_than_its_noise(change, beyond, worse):
    # The medians of the three runs are 0.020, 0.021 and 0.022: the noise is 0.002.
    again = [0.01, 0.013, 0.012], [0.02, 0.021, 0.022], [0.09, 0.06, 0.07]
    before = [row(str(i), own[0], again=own) for i, own in enumerate(again)]
    before.append(row("more", 0.02))
    now = [own | {"error": own["error"] + change} for own in before]
    text, found = said(before, now)
    assert guard.noise(before) == pytest.approx(0.002)
    assert ("beyond its noise" in text) == beyond and found == worse
    unknown = [own | {"again": []} for own in before]
    text, found = said(unknown, now)
    assert "beyond its noise" not in text and " nan " in text and not found


def test_pairs_that_the_order_of_vertices_decides_are_known():
    text, _ = said([row("a", 0.02, again=[0.02, 0.5, 0.02])], [row("a", 0.5)])
    assert "(before, the order of the vertices decided)" in text
    text, _ = said([row("a", 0.02, again=[0.02, 0.03, 0.02])], [row("a", 0.5)])
    assert "decided" not in text


def test_another_order_is_the_same_surface():
    x, y = testing.blob(0), testing.blob(1)
    truth = np.array([3, 9, 161])
    other = guard.shuffled(datasets.Shape(x, truth, None), 1)
    new = np.argsort(np.random.default_rng(1).permutation(len(x.vertices)))
    lengths = [
        np.sort(
            np.linalg.norm(np.diff(mesh.vertices[mesh.faces[:, :2]], axis=1), axis=-1),
            0,
        )
        for mesh in (x, other.mesh)
    ]
    np.testing.assert_allclose(*lengths, atol=1e-6)
    assert other.truth.tolist() == new[truth].tolist()
    # A map carried along has the same errors.
    T_xy = np.arange(len(x.vertices))
    moved = np.empty_like(T_xy)
    moved[new] = T_xy
    np.testing.assert_allclose(
        geodesic_error(moved, y, other.truth, truth[::-1].copy()),
        geodesic_error(T_xy, y, truth, truth[::-1].copy()),
    )


def test_a_run_goes_on(tmp_path, monkeypatch, capsys):
    asked = []

    def measured(data_set, pair, seed=0):
        if len(asked) == 4:
            raise KeyboardInterrupt
        asked.append((pair.x, pair.y, seed))
        numbers = {"error": 0.01 + seed / 1000, "seconds": len(asked), "share": NAN}
        return numbers | {"confidence": 0.95}

    monkeypatch.setattr(guard, "measured", measured)
    out = tmp_path / "now.json"
    command = ["guard.py", "embedded", "--data", str(tmp_path), "--out", str(out)]
    command += ["--before", str(tmp_path / "none.json")]
    monkeypatch.setattr("sys.argv", command)
    with pytest.raises(KeyboardInterrupt):
        guard.main()
    assert len(json.loads(out.read_text())["pairs"]) == 4
    done, asked[:] = asked[:], []
    guard.main()
    assert len(asked) == guard.OTHERWISE - 4 and not {*asked} & {*done}
    # The noise is measured once, and stays when the code changes.
    asked.clear()
    monkeypatch.setattr("sys.argv", [*command, "--noise", "1"])
    guard.main()
    guard.main()
    assert [one[2] for one in asked] == [*guard.SEEDS]
    found = json.loads(out.read_text())
    assert found["summary"]["embedded"]["noise"] == pytest.approx(0.002)
    monkeypatch.setattr(guard, "CODE", "another")
    monkeypatch.setattr(guard, "measured", lambda *_: measured_again)
    measured_again = {"error": 0.2, "confidence": 0.5, "share": NAN, "seconds": 1}
    monkeypatch.setattr(
        "sys.argv", [*command, "--before", str(out), "--out", f"{out}2"]
    )
    (tmp_path / "now.json2").write_text(out.read_text())
    with pytest.raises(SystemExit):
        guard.main()
    rows = json.loads((tmp_path / "now.json2").read_text())["pairs"]
    assert {own["code"] for own in rows} == {"another"}
    assert sum(bool(own["again"]) for own in rows) == 1
    assert capsys.readouterr().out.count("right to wrong") == guard.OTHERWISE
