"""How a surface curves, and that a part slides to its place by that."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from jfsf import testing
from jfsf.matching.parts import _sides as curved
from jfsf.matching.parts._region import BEND, nearest_by_curvature, target
from jfsf.matching.parts._register import register, whole_at_rest
from jfsf.matching.parts._sides import (
    curvature,
    curvatures,
    standard_curvature,
    usual_curvature,
)
from jfsf.matching.parts._surfaces import outward
from jfsf.mesh._geometry import vertex_normals
from jfsf.types import Mesh

TIMES = 0.003, 0.01, 0.03


def test_a_sphere_curves_as_computed_by_hand():
    """Coordinates are eigenfunctions with the eigenvalue 2 / radius^2."""
    radius = 1.3
    ball = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    found = curvature(Mesh(ball.vertices, ball.faces), TIMES)
    t = np.array(TIMES)
    by_hand = radius * (1 / (1 + 2 * t / radius**2) - 1) / np.sqrt(t)
    np.testing.assert_allclose(found, np.tile(by_hand, (len(found), 1)), rtol=0.02)
    # From within it is a dent.
    inside = curvature(Mesh(ball.vertices, ball.faces[:, ::-1]), TIMES)
    np.testing.assert_allclose(inside, -found, rtol=1e-6)


def test_motion_a_mirror_and_the_unit_change_nothing():
    mesh, times = testing.blob(3, subdivisions=3), np.array(TIMES)
    found = curvature(mesh, times)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    moved = Mesh(5 * mesh.vertices @ turn.T + 1, mesh.faces)
    np.testing.assert_allclose(curvature(moved, 25 * times), found, atol=1e-6)
    mirrored = Mesh(mesh.vertices * [-1, 1, 1], mesh.faces[:, ::-1])
    np.testing.assert_allclose(curvature(mirrored, times), found, atol=1e-6)


def test_between_known_times_it_is_interpolated():
    mesh = testing.blob(3, subdivisions=3)
    known = curvatures(mesh, 0.002, 0.05)
    assert known.log_times[[0, -1]] == pytest.approx(np.log([0.002, 0.05]))
    times = np.array([0.002, 0.0033, 0.017, 0.05])
    exact = curvature(mesh, times)
    assert (np.abs(known.at(times) - exact).max(0) < 0.02 * exact.std(0)).all()
    # At its own times and beyond the ends nothing is between.
    np.testing.assert_allclose(known.at(times[[0, 3]]), exact[:, [0, 3]], atol=1e-9)
    np.testing.assert_array_equal(known.at([0.001, 0.09]), known.values[:, [0, -1]])


def test_standard_values_have_the_mean_square_as_distance_and_are_cut_off(monkeypatch):
    values = np.random.default_rng(1).normal(size=(2000, 3)) * [1, 2, 5]
    usual = usual_curvature(values)
    np.testing.assert_allclose(usual, [1, 2, 5], rtol=0.1)
    monkeypatch.setattr(curved, "MAX_CURVATURE", 1e6)
    own = standard_curvature(values, usual)
    apart = np.mean(((values[0] - values[1]) / usual) ** 2)
    assert np.sum((own[0] - own[1]) ** 2) == pytest.approx(apart)
    monkeypatch.setattr(curved, "MAX_CURVATURE", 2.0)
    cut_off = standard_curvature(values, usual)
    assert np.abs(cut_off).max() == pytest.approx(2 / np.sqrt(3))


def sheet(width: float) -> Mesh:
    """A nearly flat sheet with a low hill in the middle; its rim says nothing."""
    side = np.linspace(-width, width, int(60 * width) + 1)
    at = np.stack(np.meshgrid(side, side, indexing="ij"), -1).reshape(-1, 2)
    hill = 0.03 * np.exp(-np.sum(at**2, 1) / 0.02)
    number = np.arange(len(side) ** 2).reshape(len(side), -1)
    a, b, c, d = (
        number[i : i + len(side) - 1, j : j + len(side) - 1].ravel()
        for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))
    )
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return Mesh(np.column_stack([at, hill]), faces)


@pytest.fixture(scope="module")
def slid():
    """A sheet, a smaller piece of it, and a map that is off by 0.12."""
    whole, part = sheet(0.5), sheet(0.36)
    start = KDTree(whole.vertices).query(part.vertices + [0.12, 0, 0])[1]
    of_whole = curvature(whole, curved.TIMES)
    usual = usual_curvature(of_whole)
    of_part = curvature(part, curved.TIMES)
    own = [standard_curvature(v, usual) for v in (of_part, of_whole)]
    return whole, part, start, own


def off(whole, part, T) -> float:
    """Along the sheet, from the hill's neighbourhood to where it should go."""
    near = np.linalg.norm(part.vertices[:, :2], axis=1) < 0.15
    step = whole.vertices[T[near]] - part.vertices[near]
    return float(np.linalg.norm(step[:, :2], axis=1).mean())


def test_curvature_brings_a_piece_that_slid_back_to_its_place(slid):
    whole, part, start, own = slid
    out = outward(whole, vertex_normals(*whole))
    by = {
        kind: off(
            whole, part, register(whole_at_rest(whole, out), part, start, **given).T
        )
        for kind, given in (("with", {"curvature": own}), ("without", {}))
    }
    assert by["without"] > 0.05
    assert by["with"] < by["without"] / 2
    assert off(whole, part, start) > 0.1


def test_the_nearest_by_all_three_is_that_of_all_compared(slid):
    whole, part, _, (of_part, of_whole) = slid
    x, bent = target(part, of_part), target(whole, of_whole)
    found = nearest_by_curvature(bent, x, 0.2)
    some = np.random.default_rng(0).integers(0, len(found), 40)
    apart = np.zeros((len(some), len(whole.vertices)))
    for w, a, b in (
        (1, part.vertices, whole.vertices),
        (BEND.normal_weight, x.normal, bent.normal),
        (0.2, of_part, of_whole),
    ):
        apart += w**2 * np.sum((a[some, None] - b[None]) ** 2, 2)
    np.testing.assert_allclose(
        apart[np.arange(40), found[some]], apart.min(1), rtol=1e-9
    )
