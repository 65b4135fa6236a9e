"""Parts that are made for fitting: what a camera sees, and what both parts share."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from jfsf import data
from jfsf.mesh import surface_area
from jfsf.mesh._geometry import vertex_normals
from jfsf.refine._rest import closest_rotations
from jfsf.types import Mesh

FOLDER = Path(__file__).parents[1] / "experiments"


@pytest.fixture
def made_parts():
    return import_module("experiments.accuracy.made_parts")


@pytest.mark.parametrize("camera", [(0, 0, 1), (1, -2, 0.5)])
def test_of_a_ball_the_near_half_is_seen(made_parts, camera):
    sphere = trimesh.creation.icosphere(4)
    ball = Mesh(np.array(sphere.vertices), np.array(sphere.faces))
    part = made_parts.seen(ball, np.array(camera, float), np.random.default_rng(0))
    height = part.mesh.vertices @ camera / np.linalg.norm(camera)
    assert height.min() > 0
    assert surface_area(part.mesh) / surface_area(ball) == pytest.approx(0.46, abs=0.04)
    np.testing.assert_array_equal(ball.vertices[part.index], part.mesh.vertices)


def test_what_lies_behind_is_not_seen(made_parts):
    body = data.load("man_t").mesh  # it faces +z
    rng = np.random.default_rng(0)
    front, back = (made_parts.seen(body, np.array([0, 0, z]), rng) for z in (1.0, -1.0))
    both = np.intersect1d(front.index, back.index)  # on the outline
    assert len(both) < 0.15 * len(front.index)
    for part, sign in ((front, 1), (back, -1)):
        assert (sign * vertex_normals(*part.mesh)[:, 2] > 0).mean() > 0.98
    # A ball before a cone with more area that faces the camera.
    ball = trimesh.creation.icosphere(3).apply_translation([0, 0, 12])
    cone = trimesh.creation.cone(0.9, 8)
    faces = np.concatenate([ball.faces, cone.faces + len(ball.vertices)])
    both = Mesh(np.concatenate([ball.vertices, cone.vertices]), faces)
    part = made_parts.seen(both, np.array([0, 0, 1.0]), rng)
    assert part.index.max() < len(ball.vertices)
    alone = Mesh(np.array(cone.vertices), np.array(cone.faces))
    part = made_parts.seen(alone, np.array([0, 0, 1.0]), rng)
    assert surface_area(part.mesh) > 12  # that of the near half of the ball is 6.3


@pytest.mark.parametrize("kind", ["view_whole", "view_view", "cuts"])
def test_truth_is_that_of_the_shapes(made_parts, monkeypatch, kind):
    monkeypatch.setattr(made_parts, "SIZE", 0.0)
    samples = [data.load(name) for name in ("man_walk", "woman_walk")]
    shapes = [made_parts.datasets.Shape(*s, None) for s in samples]
    x, y = made_parts._parts(*shapes, kind, np.random.default_rng(1))
    assert len(x.truth) == len(y.truth) >= made_parts.MIN_POINTS
    own, other = (s.mesh.vertices[s.template_to_vertex] for s in samples)
    # X is only scaled, so its points tell which of the template they are.
    unit_x, unit_y = (np.sqrt(surface_area(s.mesh)) for s in samples)
    away, point = KDTree(own).query(unit_x * x.mesh.vertices[x.truth])
    np.testing.assert_allclose(away, 0, atol=1e-9)
    # Y is turned, too. Of template points at one vertex of X any may be the one.
    there, wanted = unit_y * y.mesh.vertices[y.truth], other[point]
    there, wanted = there - there.mean(0), wanted - wanted.mean(0)
    turn = closest_rotations(wanted.T @ there)
    assert np.median(np.linalg.norm(there @ turn.T - wanted, axis=1)) < 0.01
