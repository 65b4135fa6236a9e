"""Pairs of landmarks by a shape's own symmetry."""

import numpy as np
import pytest
from scipy.spatial import KDTree
from shapes import sphere

from jfsf.apps.landmarks import Landmarks
from jfsf.apps.landmarks._place import on_surface
from jfsf.apps.landmarks._symmetric import mirror_pairs
from jfsf.types import Mesh

BALL = sphere(3)
EGG = Mesh(BALL.vertices * [1.0, 1.4, 2.0] + [5.0, 0, 0], BALL.faces)


def exchanged(mesh, axis):
    """The vertex at the mirrored place of each."""
    middle = np.zeros(3)
    middle[axis] = 2 * mesh.vertices[:, axis].mean()
    signs = np.where(np.arange(3) == axis, -1, 1)
    return KDTree(mesh.vertices).query(mesh.vertices * signs + middle)[1]


def at(points):
    names = ("",) * len(points)
    scaled = np.array(points, float) * [1.0, 1.4, 2.0] + [5.0, 0, 0]
    return on_surface(Landmarks(names, scaled), EGG)


POINTS = np.array(
    [
        *([-0.6, 0, 0.8], [0, 0.6, 0.8], [0.6, 0, 0.8]),
        *([0.48, 0.64, 0.6], [0, -1, 0], [-0.48, 0.64, 0.6]),
        [0.8, -0.6, 0],  # its partner was not placed
    ]
)


@pytest.mark.parametrize("system", [None, "LPS", "RAS"])
def test_pairs_are_left_and_right_and_the_rest_is_named(system):
    found = mirror_pairs(EGG, at(POINTS), exchanged(EGG, 0), system=system)
    pairs = np.array([[2, 0], [3, 5]])  # in LPS the greater x is left
    expected = pairs[:, ::-1] if system == "RAS" else pairs
    np.testing.assert_array_equal(found.pairs, expected)
    assert found.midline.tolist() == [1, 4] and found.alone.tolist() == [6]


def test_order_and_small_errors_do_not_matter():
    rng = np.random.default_rng(0)
    order = rng.permutation(len(POINTS))
    near = POINTS + rng.normal(0, 0.01, POINTS.shape)
    found = mirror_pairs(EGG, at(near[order]), exchanged(EGG, 0))
    assert {tuple(order[pair]) for pair in found.pairs} == {(2, 0), (3, 5)}
    assert set(order[found.midline]) == {1, 4} and order[found.alone].tolist() == [6]


def test_two_that_want_one_partner_are_not_both_paired():
    points = np.array([[0.6, 0, 0.8], [-0.6, 0, 0.8], [-0.6, 0.06, 0.8]])
    found = mirror_pairs(EGG, at(points), exchanged(EGG, 0))
    assert found.pairs.tolist() == [[0, 1]] and found.alone.tolist() == [2]
    found = mirror_pairs(EGG, at(points[:1]), exchanged(EGG, 0))
    assert found.pairs.shape == (0, 2) and found.alone.tolist() == [0]
