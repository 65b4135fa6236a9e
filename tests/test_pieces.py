"""Shapes of several pieces: split, assigned, joined to one map, written and read."""

from itertools import permutations
from typing import Any

import numpy as np
import pytest
from scipy.special import logit
from shapes import small
from typer.testing import CliRunner

from jfsf import testing
from jfsf.apps.cli._app import app
from jfsf.apps.export import export_mesh
from jfsf.apps.mapfiles import MapFileError, read_notes
from jfsf.apps.mapfiles._stored import read_stored
from jfsf.apps.pieces import match_components
from jfsf.apps.pieces._match import cost, write_components
from jfsf.apps.pieces._pieces import (
    TIE,
    best_assignment,
    candidates,
    pieces_of,
    places_apart,
)
from jfsf.evaluate import geodesic_error
from jfsf.mesh import MeshError, check, largest_component, vertex_colours
from jfsf.mesh._edit import split_components
from jfsf.types import Certificate, Match, Mesh

BLOBS = [testing.blob(seed) for seed in range(4)]
N = len(BLOBS[0].vertices)
TRIANGLE = Mesh(np.eye(3), np.array([[0, 1, 2]], np.int32))
STRAY = Mesh(np.full((1, 3), 9.0), np.zeros((0, 3), np.int32))


def together(*meshes, step=(5.0, 0.0, 0.0)):
    """One mesh of several, each moved by another step."""
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    vertices = [m.vertices + i * np.array(step) for i, m in enumerate(meshes)]
    faces = [m.faces + start for m, start in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate(vertices), np.concatenate(faces).astype(np.int32))


def made_up(confidence, **others):
    """A certificate with this confidence of the map alone."""
    values: dict[str, Any] = dict.fromkeys(Certificate._fields, 0.5)
    values |= {"finite": True, "landmarks": np.zeros(0), "rivals": 0.0}
    values |= {"confidence": confidence, "log_odds": logit(confidence)}
    values |= {"spectrum_gap": 0.1, "mirrored": np.nan, "region_cost": np.nan} | others
    arrays = {name: np.asarray(value) for name, value in values.items()}
    return Certificate(**arrays)


@pytest.fixture
def matched(monkeypatch):
    """Pairs that were matched; equal pieces fit, by vertices in the opposite order."""
    pairs = []

    def match(x, y, **options):
        pairs.append((x, y))
        kinds = [mesh.vertices - mesh.vertices.mean(0) for mesh in (x, y)]
        same = len(kinds[0]) == len(kinds[1]) and np.allclose(*kinds)
        certificate = made_up(0.95 if same else 0.2)
        back = np.arange(len(x.vertices))[::-1] % len(y.vertices)
        other = np.arange(len(y.vertices))[::-1] % len(x.vertices)
        likely = (np.full(len(mesh.vertices), 0.75) for mesh in (x, y))
        return Match(back, other, np.eye(3), certificate, None, None, *likely)

    monkeypatch.setattr("jfsf.apps.pieces._match.match", match)
    return pairs


def test_a_mesh_is_split_into_its_components():
    whole = together(TRIANGLE, STRAY, BLOBS[0], BLOBS[1])
    order = np.random.default_rng(0).permutation(len(whole.vertices))
    whole = testing.relabel(whole, order)
    parts = split_components(whole)
    assert sorted(len(mesh.vertices) for mesh, _ in parts) == [3, N, N]
    assert [index[0] for _, index in parts] == sorted(index[0] for _, index in parts)
    for mesh, index in parts:
        assert check(mesh).components == 1 and index.dtype == np.int32
        assert np.array_equal(mesh.vertices, whole.vertices[index])
    corners = np.concatenate([index[mesh.faces] for mesh, index in parts])
    assert {*map(tuple, corners)} == {*map(tuple, whole.faces)}
    largest = largest_component(whole)
    same = [part for part in parts if np.array_equal(part.index, largest.index)]
    assert np.array_equal(same[0].mesh.faces, largest.mesh.faces)
    assert split_components(STRAY) == []


def test_pieces_that_cannot_be_matched_are_counted():
    crumb = Mesh(BLOBS[1].vertices * 0.01, BLOBS[1].faces)
    large = Mesh(BLOBS[2].vertices * 2, BLOBS[2].faces)
    whole = together(TRIANGLE, STRAY, BLOBS[0], crumb, TRIANGLE, large)
    pieces, left_out = pieces_of(whole)
    assert [len(piece.index) for piece in pieces] == [N, N]
    assert pieces[0].share > pieces[1].share
    assert pieces[0].index[0] > pieces[1].index[0]
    assert [(out.why, out.pieces, out.vertices) for out in left_out] == [
        ("of fewer than 160 vertices", 2, 6),
        ("of less than 0.01 of the area", 1, N),
        ("without a face", 0, 1),
    ]
    shares = [piece.share for piece in (*pieces, *left_out)]
    assert sum(shares) == pytest.approx(1)


def test_a_piece_in_one_place_is_left_out():
    point = Mesh(np.zeros((N, 3)), BLOBS[0].faces)
    pieces, left_out = pieces_of(together(BLOBS[0], point), min_share=0)
    assert "coincide" in left_out[0].why and len(pieces) == 1


@pytest.mark.parametrize(
    "mesh, options, error",
    [
        (Mesh(np.eye(3), np.zeros((0, 3), np.int32)), {}, "no faces"),
        (together(TRIANGLE, TRIANGLE), {}, "none of its 2 pieces .*: 2 of fewer"),
        (BLOBS[0], {"min_share": 1.0}, "min_share is 1.0"),
        (Mesh(BLOBS[0].vertices * np.nan, BLOBS[0].faces), {}, "finite"),
    ],
)
def test_what_has_no_pieces_is_refused(mesh, options, error):
    with pytest.raises(ValueError, match=error):
        pieces_of(mesh, **options)


@pytest.mark.parametrize("shape", [(3, 3), (2, 4), (4, 2), (1, 1)])
def test_the_assignment_is_the_best_of_all(shape):
    costs = np.random.default_rng(sum(shape)).random(shape)
    found, margins = best_assignment(costs, np.zeros(shape))
    table = costs if shape[0] <= shape[1] else costs.T
    orders = permutations(range(table.shape[1]), table.shape[0])
    pairs = [[*enumerate(order)] for order in orders]
    sums = [sum(table[pair] for pair in one) for one in pairs]
    assert sum(costs[pair] for pair in found) == pytest.approx(min(sums))
    for (i, j), margin in zip(found, margins, strict=True):
        pair = (i, j) if shape[0] <= shape[1] else (j, i)
        others = [s for s, one in zip(sums, pairs, strict=True) if pair not in one]
        least = min(others) - min(sums) if others else np.inf
        assert margin == pytest.approx(least)


def test_places_decide_where_costs_are_equal():
    here = np.array([[0.0, 0, 0], [1, 0, 0], [4, 0, 0]])
    apart = places_apart(here, 10 * here[[2, 0, 1]] + 7)
    assert apart.max() == 1
    found, margins = best_assignment(np.full((3, 3), 0.5), apart)
    assert found == [(0, 1), (1, 2), (2, 0)] and max(margins) < TIE
    # Not where they differ.
    costs = np.where(np.eye(3), 0.1, 0.5)
    found, margins = best_assignment(costs, apart)
    assert found == [(0, 0), (1, 1), (2, 2)] and min(margins) > TIE
    assert not places_apart(here[:1], here[:1]).any()


def test_pairs_that_were_not_matched_are_not_assigned():
    inf = np.inf
    found = best_assignment(np.array([[0.9, inf], [0.1, inf]]), np.zeros((2, 2)))
    assert found[0] == [(1, 0)]
    found = best_assignment(np.array([[0.9, inf], [inf, 0.1]]), np.zeros((2, 2)))
    assert found == ([(0, 0), (1, 1)], [inf, inf])


def test_candidates_are_the_nearest_and_an_assignment():
    unlike = np.abs(np.arange(5.0)[:, None] - [0, 1, 2, 3, 4])
    chosen = candidates(unlike, np.zeros((5, 5)), nearest=1)
    assert np.array_equal(chosen, np.eye(5, dtype=bool))
    # All like the first one: each piece has a partner all the same.
    chosen = candidates(np.tile([0.0, 1, 2], (3, 1)), np.zeros((3, 3)), nearest=1)
    assert chosen[:, 0].all() and chosen.any(0).all()
    # Of two pieces beside many only a few pairs, on either side.
    unlike = np.abs(np.array([[2.2], [7.2]]) - np.arange(9))
    few = candidates(unlike, np.zeros((2, 9)), nearest=3)
    assert np.flatnonzero(few[0]).tolist() == [1, 2, 3] and few.sum() == 6
    assert np.array_equal(candidates(unlike.T, np.zeros((9, 2)), nearest=3), few.T)
    assert candidates(np.zeros((2, 4)), np.zeros((2, 4)), nearest=3).all()
    # Of equal pieces those that lie alike.
    places = 1 - np.eye(4)
    chosen = candidates(np.zeros((4, 4)), places, nearest=1)
    assert np.array_equal(chosen, np.eye(4, dtype=bool))


def test_the_cost_is_that_of_pieces_that_do_not_belong_together():
    assert cost(made_up(0.9)) == pytest.approx(0.2)
    assert cost(made_up(np.nan, spectrum_gap=np.nan)) == 2
    # A sphere has many maps; a left hand is no right one; other shapes are others.
    assert cost(made_up(0.9, rivals=9.0, share=0.1)) == pytest.approx(0.2)
    assert cost(made_up(0.9, mirrored=0.99)) > 1
    assert cost(made_up(0.9, spectrum_gap=2.0)) > 1.4


def test_pieces_go_to_their_kind_whatever_their_order(matched):
    x = together(TRIANGLE, BLOBS[0], BLOBS[1])
    y = together(BLOBS[1], STRAY, BLOBS[0])
    found = match_components(x, y)
    assert len(matched) == 4 and len(found.pairs) == 2
    assert [pair.confidence for pair in found.pairs] == [0.95, 0.95]
    assert not any(pair.tied for pair in found.pairs)
    assert found.left_out_x[0].pieces == 1 and found.left_out_y[0].pieces == 0
    assert (found.T_xy[:3] == -1).all() and found.T_yx[N] == -1
    back = np.arange(N)[::-1]
    assert np.array_equal(found.T_xy[3:], [*(back + N + 1), *back])
    assert np.array_equal(found.T_yx[found.T_xy[3:]], np.arange(3, 2 * N + 3))
    assert np.array_equal(found.pair_x[3:], found.pair_y[found.T_xy[3:]])
    assert found.T_xy.dtype == found.pair_y.dtype == np.int32
    for pair in found.pairs:
        assert np.array_equal(pair.x.mesh.vertices, x.vertices[pair.x.index])


def test_equal_pieces_are_a_tie(matched):
    x, y = together(BLOBS[0], BLOBS[0]), together(BLOBS[0], BLOBS[0], step=(-9, 0, 0))
    found = match_components(x, y)
    assert all(pair.tied for pair in found.pairs)
    # The one that is farther along x goes to the one that is.
    assert (found.T_xy[:N] >= N).all()


def test_a_piece_without_a_partner_is_said(matched):
    found = match_components(together(BLOBS[0], BLOBS[1]), BLOBS[1])
    assert found.pair_x.tolist() == [-1] * N + [0] * N
    assert len(found.pairs) == 1 and not found.pairs[0].tied
    assert found.alone_x[0].index[0] == 0 and found.alone_y == ()


def test_of_many_pieces_those_are_matched_that_are_alike(matched):
    order = [2, 0, 3, 1]
    x, y = together(*BLOBS), together(*(BLOBS[i] for i in order))
    found = match_components(x, y, nearest=1, cache=False)
    assert len(matched) == 4
    assert found.pair_x[::N].tolist() == found.pair_y[::N][np.argsort(order)].tolist()
    with pytest.raises(ValueError, match="nearest is 0"):
        match_components(x, y, nearest=0)


@pytest.fixture
def folder(tmp_path):
    export_mesh(tmp_path / "x.ply", together(TRIANGLE, BLOBS[0], BLOBS[1]))
    export_mesh(tmp_path / "y.ply", together(BLOBS[1], BLOBS[2], BLOBS[0]))
    return tmp_path


def run(*args):
    return CliRunner().invoke(app, [str(arg) for arg in args])


def test_the_file_counts_the_vertices_of_the_meshes(matched, folder):
    x, y, out = (folder / name for name in ("x.ply", "y.ply", "map.npz"))
    done = run("match", x, y, "--out", out, "--components")
    assert done.exit_code == 0, done.output
    assert "0.950" in done.output and f"wrote {out}" in done.output
    said = f"{x}: leaves out 1 piece of fewer than 160 vertices: 3 vertices, "
    assert said in done.output
    assert f"{y}: the piece with vertex {N} has no partner: {N} vertices" in done.output
    assert any(note.startswith(said) for note in read_notes(out))
    with np.load(out) as file:
        assert (file["T_xy"][:3] == -1).all() and (file["T_xy"][3:] >= 0).all()
        assert (file["T_yx"][N : 2 * N] == -1).all()
        assert np.isnan(file["confidence_x"][:3]).all()
        assert file["confidence_y"][0] == 0.75
        assert file["pair_confidence"].tolist() == [0.95, 0.95]
        assert file["pair_margin"].shape == (2,)
    stored = read_stored(out, n_x=2 * N + 3, n_y=3 * N)
    assert stored.index_x.tolist() == [*range(3, 2 * N + 3)]
    assert stored.index_y.tolist() == [*range(N), *range(2 * N, 3 * N)]
    there = np.asarray(stored.index_y)[stored.T_xy]
    assert np.array_equal(there, np.load(out)["T_xy"][3:])


def test_pictures_and_exports_show_what_has_no_partner_in_grey(matched, folder):
    x, y, out = (folder / name for name in ("x.ply", "y.ply", "map.npz"))
    png, coloured = folder / "map.png", folder / "coloured.ply"
    options = "--png", png, "--export", coloured, "--up", "y"
    done = run("match", x, y, "--out", out, "--components", *options)
    assert done.exit_code == 0, done.output
    assert f"wrote {png}" in done.output and f"wrote {coloured}" in done.output
    assert png.stat().st_size > 10_000
    colours = np.asarray(vertex_colours(coloured))[:, :3]
    assert len(colours) == 2 * N + 3
    grey = (colours == colours[0]).all(1)
    assert grey[:3].all() and not grey[3:].any()
    assert np.ptp(colours[0]) < 0.1 < np.ptp(colours[3:], axis=0).min()


def test_the_map_is_evaluated_and_carries_labels(matched, folder):
    x, y, out = (folder / name for name in ("x.ply", "y.ply", "map.npz"))
    run("match", x, y, "--out", out, "--components")
    truth = np.load(out)["T_xy"].clip(0)
    np.savetxt(folder / "x.vts", np.arange(len(truth)) + 1, "%d")
    np.savetxt(folder / "y.vts", truth + 1, "%d")
    known = "--gt-x", folder / "x.vts", "--gt-y", folder / "y.vts", "--every", 50
    done = run("evaluate", x, y, out, *known)
    assert done.exit_code == 0, done.output
    assert "error mean" in done.output and "3 of" in done.output
    assert "no finite distance" not in done.output
    labels = np.repeat([4, 5, 6], N)
    np.savetxt(folder / "labels.txt", labels, "%d")
    carried = folder / "carried.txt"
    done = run(
        "transfer", x, y, out, "--labels", folder / "labels.txt", "--out", carried
    )
    assert done.exit_code == 0, done.output
    assert np.loadtxt(carried, int)[:3].tolist() == [-1] * 3


@pytest.mark.parametrize(
    "maps, error",
    [
        ({"T_xy": [-1, -1]}, "no vertex has a partner"),
        ({"T_xy": [-1, 3]}, "the target has 3 vertices"),
        ({"T_xy": [-1, 0, 1]}, "has 3 entries"),
        ({"T_xy": [-2, -1]}, "is -2"),
        ({"T_xy": [-1, 0], "T_yx": [-1, 1, 1]}, "partner, 0, that has none"),
        ({"T_xy": [0, 1], "T_yx": [0, -1, 1]}, "partner, 1, that has none"),
    ],
)
def test_a_map_with_wrong_partners_is_refused(tmp_path, maps, error):
    np.savez(tmp_path / "map.npz", **maps)
    with pytest.raises(MapFileError, match=error):
        read_stored(tmp_path / "map.npz", n_x=2, n_y=3)


def test_a_map_one_way_needs_no_other(tmp_path):
    np.savez(tmp_path / "map.npz", T_xy=[2, -1])
    stored = read_stored(tmp_path / "map.npz", n_x=2, n_y=3)
    assert stored.T_xy.tolist() == [2] and stored.index_x.tolist() == [0]
    assert stored.T_yx is None and stored.index_y is None


@pytest.mark.parametrize(
    "options, error",
    [
        (["--partial"], "--components does not go with --partial: leave it out"),
        (["--base", 0], "with --base"),
        (["--gt-x", "x.vts", "--report", "a.html"], "--report, --gt-x: leave them out"),
        (["--repair"], "jfsf info X --repair FILE"),
        (["--checker"], "--checker goes with --export"),
    ],
)
def test_options_for_one_piece_are_refused(folder, options, error):
    x, out = folder / "x.ply", folder / "map.npz"
    done = run("match", x, x, "--out", out, "--components", *options)
    assert done.exit_code == 1 and error in done.output.replace("\n", " ")
    assert not out.exists()


def test_errors_name_the_file(folder):
    export_mesh(folder / "crumbs.ply", together(TRIANGLE, TRIANGLE))
    paths = folder / "x.ply", folder / "crumbs.ply"
    done = run("match", *paths, "--out", folder / "map.npz", "--components")
    assert done.exit_code == 1
    assert f"jfsf: {paths[1]}: none of its 2 pieces" in done.output.replace("\n", " ")
    with pytest.raises(MapFileError, match="written as .npz"):
        write_components(folder / "map.mat", None)  # type: ignore


@pytest.mark.slow  # four pairs of bodies in earnest
def test_bodies_go_to_their_own_kind(tmp_path, run_once, monkeypatch):
    names_x, names_y = ("child_kick", "man_kick"), ("man_t", "child_t")
    (child_x, at_child_x), (man_x, at_man_x) = (small(n, 2000) for n in names_x)
    (man_y, at_man_y), (child_y, at_child_y) = (small(n, 2000) for n in names_y)
    x, y = together(child_x, man_x), together(man_y, child_y, step=(0, 0, 3.0))
    truth_x = np.concatenate([at_child_x, at_man_x + len(child_x.vertices)])
    truth_y = np.concatenate([at_child_y + len(man_y.vertices), at_man_y])
    export_mesh(tmp_path / "x.ply", x)
    export_mesh(tmp_path / "y.ply", y)
    results = []

    def kept(*meshes, **options):
        results.append(match_components(*meshes, **options))
        return results[-1]

    monkeypatch.setattr("jfsf.apps.pieces.match_components", kept)
    paths = tmp_path / "x.ply", tmp_path / "y.ply"
    done = run("match", *paths, "--out", tmp_path / "map.npz", "--components")
    assert done.exit_code == 0, done.output
    found = results[0]
    assert len(found.pairs) == 2 and (found.T_xy >= 0).all()
    assert all(pair.confidence > 0.9 and not pair.tied for pair in found.pairs)
    assert found.pairs[0].margin > 2 * TIE
    with np.load(tmp_path / "map.npz") as file:
        assert np.array_equal(file["T_xy"], found.T_xy)
    error = geodesic_error(found.T_xy, y, truth_x[::40], truth_y[::40])
    assert error.mean() < 0.03 and np.isfinite(error).all()


@pytest.mark.parametrize(
    "faces, words",
    [
        (np.where(BLOBS[0].faces == 3, 5000, BLOBS[0].faces), "names vertex 5000"),
        (np.where(BLOBS[0].faces == 3, -1, BLOBS[0].faces), "names vertex -1"),
        (BLOBS[0].faces.astype(float), "faces are float64"),
    ],
)
def test_bad_faces_are_named(faces, words):
    with pytest.raises(MeshError, match=f"scan: .*{words}"):
        pieces_of(Mesh(BLOBS[0].vertices, faces), name="scan")


def test_whole_numbers_for_coordinates_are_no_other_shape():
    large = np.round((BLOBS[0].vertices + 4) * 3000)
    small = np.round((BLOBS[0].vertices + 4) * 1500) + 30000
    faces = np.concatenate([BLOBS[0].faces, BLOBS[0].faces + N])
    both = np.concatenate([large, small])
    exact, whole = (
        pieces_of(Mesh(both.astype(kind), faces))[0] for kind in (float, np.uint16)
    )
    for one, other in zip(exact, whole, strict=True):
        assert one.share == pytest.approx(other.share)
        np.testing.assert_allclose(one.place, other.place)
