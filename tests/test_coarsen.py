"""coarsen: fewer vertices, all of them the mesh's own, and the same shape."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import KDTree

from jfsf.data import load
from jfsf.mesh import coarsen, surface_area
from jfsf.types import Mesh

MESH = load("man_up").mesh
NO_FACES = np.zeros((0, 3), np.int32)


@pytest.mark.parametrize("num", [1, 50, 1000, 4000])
def test_keeps_vertices_of_its_own_and_the_shape(num):
    mesh, index = coarsen(MESH, num)
    assert num / 3 < len(index) <= num
    assert np.array_equal(mesh.vertices, MESH.vertices[index])
    assert (np.diff(index) > 0).all()
    if num >= 1000:
        away = KDTree(mesh.vertices).query(MESH.vertices)[0]
        assert away.max() < 0.1 * 1.8
        assert abs(surface_area(mesh) / surface_area(MESH) - 1) < 0.15
    assert len(mesh.faces) == 0 or 0 <= mesh.faces.min() <= mesh.faces.max() < len(
        index
    )
    a, b, c = mesh.faces.T
    assert not ((a == b) | (b == c) | (c == a)).any()
    assert len(np.unique(np.sort(mesh.faces, 1), axis=0)) == len(mesh.faces)


@given(st.integers(1, 40), st.integers(1, 40))
def test_clouds_of_any_size(n, num):
    points = np.random.default_rng(n).random((n, 3))
    mesh, index = coarsen(Mesh(points, NO_FACES), num)
    assert 1 <= len(index) <= max(num, 1) or len(index) == n <= num
    assert mesh.faces.shape == (0, 3)
    assert np.array_equal(mesh.vertices, points[index])


def test_small_meshes_come_back_whole():
    mesh, index = coarsen(MESH, len(MESH.vertices))
    assert mesh is MESH and np.array_equal(index, np.arange(len(MESH.vertices)))


def test_all_points_in_one_place():
    assert len(coarsen(Mesh(np.zeros((9, 3)), NO_FACES), 2).index) == 1


def test_refuses_no_vertices():
    with pytest.raises(ValueError, match="num is 0"):
        coarsen(MESH, 0)
