"""Damages of experiments: what is left of a shape is where its index says."""

from functools import partial
from importlib import import_module

import numpy as np
import pytest

from jfsf import data
from jfsf.mesh import surface_area, validate

SAMPLE = data.load("man_walk")
MESH = SAMPLE.mesh
N = len(MESH.vertices)


@pytest.fixture(scope="module")
def damages():
    return import_module("experiments.accuracy.damages")


@pytest.mark.parametrize(
    ("kind", "options", "least", "most"),
    [
        ("clean", {}, N, N),
        ("noise", {"size": 0.01}, N, N),
        ("spikes", {"number": 20}, N, N),
        ("holes", {"number": 5, "radius": 0.08}, 0.7 * N, 0.97 * N),
        ("one_arm", {}, 0.75 * N, 0.95 * N),
        ("half_thinned", {"to": 0.1}, 0.5 * N, 0.7 * N),
        ("coarse", {"n": 500}, 450, 550),
        ("fine", {"n": 6000}, 6000, 6000),
    ],
)
def test_the_index_leads_to_what_is_left(damages, kind, options, least, most):
    before = [array.copy() for array in MESH]
    make = partial(getattr(damages, kind), **options)
    found = make(SAMPLE, np.random.default_rng(0))
    again = make(SAMPLE, np.random.default_rng(0))
    assert all(np.array_equal(*pair) for pair in zip(before, MESH, strict=True))
    assert all(
        np.array_equal(*pair) for pair in zip(found.mesh, again.mesh, strict=True)
    )
    validate(found.mesh)
    assert least <= len(found.mesh.vertices) <= most
    assert found.index.shape == (N,)
    left = found.index >= 0
    assert len(np.unique(found.index[left])) == left.sum()
    away = np.linalg.norm(
        found.mesh.vertices[found.index[left]] - MESH.vertices[left], axis=1
    ) / np.sqrt(surface_area(MESH))
    limit = {"noise": 0.06, "spikes": 0.5 + 1e-9, "coarse": 0.05, "half_thinned": 0.05}
    assert away.max() <= limit.get(kind, 1e-7)
    if kind == "spikes":
        assert (away > 0.4).sum() == 20


def test_an_arm_is_cut_off_on_one_side(damages):
    pose = data.load("man_t")
    found = damages.one_arm(pose, np.random.default_rng(0))
    across = found.mesh.vertices[:, 0]
    middle = MESH.vertices[:, 0].mean()
    assert across.max() - middle < 0.75 * (middle - across.min())


def test_a_cloud_has_no_faces(damages):
    found = damages.cloud(SAMPLE, np.random.default_rng(0))
    assert len(found.mesh.faces) == 0
    assert np.array_equal(found.mesh.vertices, MESH.vertices)
