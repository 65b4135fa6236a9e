"""Changes of X in the experiments: what they keep, and where its vertices go."""

import numpy as np
import pytest

from experiments.accuracy import changes
from jfsf import testing
from jfsf.mesh import surface_area
from jfsf.mesh._geometry import boundary_edges

MESH = testing.blob(3, subdivisions=3)
N = len(MESH.vertices)


def test_no_change_is_none():
    same = changes.changed(MESH, changes.Changes(), 0)
    np.testing.assert_array_equal(same.mesh.vertices, MESH.vertices)
    np.testing.assert_array_equal(same.near, np.arange(N))
    assert same.scale == 1


def test_a_turn_and_a_scale_keep_the_form():
    asked = changes.Changes(turn=True, scale=(0.3, 3.0))
    first, again = (changes.changed(MESH, asked, seed) for seed in (1, 1))
    np.testing.assert_array_equal(first.mesh.vertices, again.mesh.vertices)
    area = surface_area(MESH)
    assert surface_area(first.mesh) == pytest.approx(area * first.scale**2)
    assert 0.3 <= first.scale <= 3 and first.scale != 1
    apart = lambda v: np.linalg.norm(v - v[0], axis=1)
    moved = apart(first.mesh.vertices) / first.scale
    np.testing.assert_allclose(moved, apart(MESH.vertices), atol=1e-12)
    assert np.abs(first.mesh.vertices - MESH.vertices).max() > 0.1


def test_vertices_go_to_the_nearest_that_are_left():
    fewer = changes.changed(MESH, changes.Changes(holes=2, decimate=0.5), 0)
    n = len(fewer.mesh.vertices)
    assert 0.35 * N < n < 0.55 * N and len(boundary_edges(fewer.mesh.faces))
    assert fewer.near.shape == (N,) and fewer.near.max() < n
    away = np.linalg.norm(fewer.mesh.vertices[fewer.near] - MESH.vertices, axis=1)
    assert np.median(away) < 0.05 * np.sqrt(surface_area(MESH))
