"""The protocol of the experiments: roles, one definition of right, and what is read."""

import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
from documents import README, ROOT

from experiments.accuracy import datasets, match_pairs, protocol
from experiments.figures import figure_reliability
from jfsf import data, testing
from jfsf.matching._arguments import MatchInputs
from jfsf.matching._pairs import Attempt, PairState, Standing
from jfsf.types import SOURCES, Certificate, Match

FOLDER = ROOT / "experiments"


def write_off(path, mesh):
    path.parent.mkdir(parents=True, exist_ok=True)
    counts = f"OFF\n{len(mesh.vertices)} {len(mesh.faces)} 0\n"
    points = "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in mesh.vertices.tolist())
    faces = "".join(f"3 {a} {b} {c}\n" for a, b, c in mesh.faces.tolist())
    path.write_text(counts + points + faces)


def write(path, values):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{value}\n" for value in values))


def test_every_set_says_what_it_is():
    assert len(protocol.SETS) == len(protocol._ROWS)  # no second line replaces one
    for name, own in protocol.SETS.items():
        assert own.name == name and own.roles
        assert set(own.roles) <= set(protocol.ROLES)
        assert own.kind in protocol.KINDS and own.truth in protocol.TRUTHS
        assert not any(str(folder).startswith("/") for folder in own.folders)
        assert bool(own.folders) == (own.truth != "package")
    used = {role for own in protocol.SETS.values() for role in own.roles}
    assert used == set(protocol.ROLES)


def test_sets_are_named_by_role_too():
    everything = protocol.named(["all"])
    assert everything == list(protocol.SETS.values())
    by_role = [own for role in protocol.ROLES for own in protocol.named([role])]
    assert set(by_role) == set(everything)
    assert protocol.named(["embedded", "embedded"]) == [protocol.SETS["embedded"]]
    with pytest.raises(ValueError, match="no data set 'faust'; there are faust_r"):
        protocol.named(["faust"])


def test_roles_take_turns():
    own = protocol.SETS["embedded"]._replace(roles=("fit", "fit", "report"))
    assert [own.role(i) for i in range(4)] == ["fit", "fit", "report", "fit"]


def test_there_is_one_definition_of_a_right_map():
    assert protocol.is_right(0.0999) and not protocol.is_right(0.1)
    assert not protocol.is_right(np.nan)
    for path in FOLDER.rglob("*.py"):
        defined = re.findall(r"^(?:RIGHT|LOST|WRONG)\b.* = ", path.read_text(), re.M)
        assert not defined or path.name == "protocol.py", path


def test_the_readme_says_what_each_set_is_for():
    rows = [r.split("|")[1:-1] for r in README.read_text().splitlines() if "|" in r]
    rows = [row for row in rows if len(row) == 5 and "`" in row[-1]]
    assert len(rows) >= 8
    for _, role, *_, where in rows:
        assert role.strip() in protocol.ROLES
        named = re.search(r"`match_(\w+?)\.json`", where)
        if named:
            assert (role.strip(),) == protocol.SETS[named[1]].roles, named[1]


def test_a_folder_with_a_template(tmp_path):
    one, two = testing.blob(0), testing.blob(1)
    write_off(tmp_path / "some" / "a.off", one)
    write_off(tmp_path / "more" / "off" / "b.off", two)
    write(tmp_path / "some" / "corres" / "a.vts", [1, 5, 5])
    write(tmp_path / "some" / "corres" / "a.sym.vts", [1, 7, 7])
    write(tmp_path / "more" / "corres" / "b.vts", [2, 3, 162])
    write(tmp_path / "some" / "pairs.txt", ["a b", "", "b a", "a b"])
    own = protocol.DataSet("s", ("some", "more"), "template", ("fit",), "near")
    own = protocol.below(own, tmp_path)
    pairs = datasets.pairs_of(own)
    assert [(pair.x, pair.y) for pair in pairs] == [("a", "b"), ("b", "a")]
    x, y = datasets.load_pair_of(own, pairs[0])
    np.testing.assert_allclose(x.mesh.vertices, one.vertices)
    assert x.truth.tolist() == [0, 4, 4] and y.truth.tolist() == [1, 2, 161]
    assert x.mirror.tolist() == [0, 6, 6] and y.mirror is None
    with pytest.raises(SystemExit, match="no c.off"):
        datasets.load_shape(own, "c")


def test_landmarks_begin_at_zero_and_the_shorter_list_counts(tmp_path):
    for name, at in (("1", [0, 9, 161]), ("2", [3, 4])):
        write_off(tmp_path / "off" / f"{name}.off", testing.blob(0))
        write(tmp_path / "vts" / f"{name}.vts", [f"{v} 0.5 1e-3 2" for v in at])
    write(tmp_path / "rival.txt", ["1 2 0.25 86"])
    args = SimpleNamespace(
        data=[tmp_path], pairs=tmp_path / "rival.txt", embedded=False, within=None
    )
    own = datasets.asked(args)
    (pair,) = datasets.chosen(args)
    assert own.truth == "landmarks" and pair.rival == 0.25
    x, y = datasets.load_pair_of(own, pair)
    assert x.truth.tolist() == [0, 9] and y.truth.tolist() == [3, 4]


def test_truth_named_in_the_list_and_loose_pieces(tmp_path):
    blob, n = testing.blob(0), 162
    loose = np.array([[9.0, 9, 9], [9, 9, 8], [9, 8, 9]])
    # The loose piece comes first, so that all vertices are renumbered.
    both = blob._replace(
        vertices=np.concatenate([loose, blob.vertices]),
        faces=np.concatenate([[[0, 1, 2]], blob.faces + 3]).astype(np.int32),
    )
    write_off(tmp_path / "off" / "a.off", both)
    write_off(tmp_path / "off" / "b.off", blob)
    write(tmp_path / "gt" / "x.vts", [2, 4, 5])
    write(tmp_path / "gt" / "y.vts", [7, 8, 9])
    write(tmp_path / "pairs.txt", ["off/a.off off/b.off gt/x.vts gt/y.vts"])
    args = SimpleNamespace(data=[tmp_path], pairs=None, embedded=False, within=None)
    own = datasets.asked(args)
    assert own.truth == "listed"
    (pair,) = datasets.chosen(args)
    assert (pair.x, pair.y) == ("a", "b")
    x, y = datasets.load_pair_of(own, pair)
    assert x.truth.tolist() == [1, 3, 4] and y.truth.tolist() == [6, 7, 8]
    x, y = datasets.load_pair_of(own._replace(largest=True), pair)
    assert len(x.mesh.vertices) == n
    assert x.truth.tolist() == [0, 1] and y.truth.tolist() == [7, 8]


def test_truth_of_two_lengths_is_an_error(tmp_path):
    for name, at in (("a", [1, 2]), ("b", [1])):
        write_off(tmp_path / f"{name}.off", testing.blob(0))
        write(tmp_path / "corres" / f"{name}.vts", at)
    write(tmp_path / "pairs.txt", ["a b"])
    args = SimpleNamespace(data=[tmp_path], pairs=None, embedded=False, within=None)
    with pytest.raises(SystemExit, match="truth of 2 and 1 points"):
        datasets.load_pair(SimpleNamespace(**vars(args), identity=False), "a", "b")


def made_up(mesh_x, mesh_y, images, confidence):
    """A pair on the way, with attempts of these maps; the last has won."""
    attempts, back = [], np.zeros(len(mesh_y.vertices), int)
    for T_xy, likely in zip(images, confidence, strict=True):
        figures = dict.fromkeys(Certificate._fields, np.zeros(()))
        figures |= {"confidence": np.array(likely), "landmarks": np.zeros(0)}
        source = SOURCES[3 if attempts else 1]
        found = Match(T_xy, back, None, Certificate(**figures))
        attempts.append(Attempt(source, None, found))
    last = len(attempts) - 1
    unknown = [Standing()] * len(attempts)
    state = PairState(None, MatchInputs(), None, None, attempts, unknown)
    state.won = last
    return state


def test_a_run_writes_the_evidence_of_every_attempt(tmp_path, monkeypatch):
    asked = []

    def attempted_pair(mesh_x, mesh_y, *, settings):
        asked.append(settings.retry_below)
        names = {len(data.load(n).mesh.vertices): n for n in data.names()}
        x, y = (data.load(names[len(m.vertices)]) for m in (mesh_x, mesh_y))
        right = np.zeros(len(mesh_x.vertices), int)
        right[x.template_to_vertex] = y.template_to_vertex
        wrong = np.zeros(len(mesh_x.vertices), int)
        return made_up(mesh_x, mesh_y, [wrong, right], [0.2, 0.95])

    monkeypatch.setattr(match_pairs, "attempted_pair", attempted_pair)
    command = ["match_pairs.py", "embedded", "--spread", "2", "--exhaustive"]
    monkeypatch.setattr("sys.argv", [*command, "--out", str(tmp_path)])
    match_pairs.main()
    assert asked == [1, 1]
    (path,) = tmp_path.iterdir()
    assert path.name == "match_embedded_exhaustive.json"
    record = json.loads(path.read_text())
    assert record["settings"]["points"] == "250 at most, seed 0"
    assert record["settings"]["right"] == protocol.RIGHT
    for row in record["pairs"]:
        first, second = row["attempts"]
        assert row["won"] == 1 and row["points"] == 250 and row["role"] == "choose"
        assert first["source"] == "search" and second["source"] == "coarse copies"
        assert row["error"] == second["error"] < 0.01 < 0.1 < first["error"]
        assert row["confidence"] == 0.95 and first["confidence"] == 0.2
        assert set(Certificate._fields) - set(first) == {"landmarks"}
        assert row["n_x"] == len(data.load(row["x"]).mesh.vertices)
    found = record["summary"]["all"]
    assert found["pairs"] == 2 and found["attempts"] == 4 and found["wrong"] == 0


@pytest.mark.parametrize(
    "wrong",
    [
        ["faust"],
        ["embedded", "--pairs", "a"],
        ["embedded", "--out", "a.json"],
        ["faust_r", "--data", "a", "--data", "b"],
    ],
)
def test_wrong_usage_is_said_in_a_line(monkeypatch, capsys, wrong):
    monkeypatch.setattr("sys.argv", ["match_pairs.py", *wrong])
    with pytest.raises(SystemExit):
        match_pairs.main()
    assert "error: " in capsys.readouterr().err.splitlines()[-1]


def test_the_summary_counts_what_is_right_and_sure():
    rows = [
        {"error": error, "confidence": likely, "rival": rival, "role": role}
        for error, likely, rival, role in (
            (0.01, 0.95, 0.3, "fit"),
            (0.02, 0.60, None, "choose"),  # right, but unsure
            (0.30, 0.92, 0.1, "fit"),  # wrong, but sure
            (0.10, 0.10, None, "choose"),
            (0.05, np.nan, None, "fit"),
        )
    ]
    rows = [{**row, "attempts": [1], "seconds": 2.0} for row in rows]
    found = match_pairs.summaries(rows)
    assert set(found) == {"all", "fit", "choose"}
    counts = ("wrong", "sure", "wrong_sure", "right_unsure", "below_rival")
    assert [found["all"][name] for name in counts] == [2, 2, 1, 1, 1]
    assert found["fit"]["pairs"] == 3 and found["choose"]["wrong"] == 1
    assert found["all"]["rival_mean"] == 0.2 and found["all"]["median"] == 0.05
    assert "rival_mean" not in found["choose"]


def test_reliability_is_drawn(tmp_path):
    maps = np.array([0.95, 1.0, 0.31]), np.array([True, False, False])
    path = tmp_path / "a.png"
    figure_reliability.draw({"all": maps, "embedded": maps}, path)
    assert path.stat().st_size > 1000
