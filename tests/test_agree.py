"""What the template is put by: the mean of all trusted ways."""

import numpy as np
import pytest
import trimesh

from jfsf.apps.collections import agreed_map
from jfsf.apps.collections._grow import Graph, Matched, Paths
from jfsf.apps.collections._member import OtherShape
from jfsf.types import Maps, Mesh

WITHIN = 0.1


def ball(seed):
    """Points on a sphere, with numbers of their own, and where each of `ball(0)` is."""
    sphere = trimesh.creation.icosphere(3)
    order = np.random.default_rng(seed).permutation(len(sphere.vertices))
    number = np.argsort(order)
    if seed == 0:
        order, number = np.arange(len(order)), np.arange(len(order))
    return Mesh(sphere.vertices[order], number[sphere.faces]), number


def moved(mesh, rng, size):
    """For each vertex one about so far away."""
    points = mesh.vertices + size * rng.standard_normal(mesh.vertices.shape)
    return np.argmin(np.linalg.norm(points[:, None] - mesh.vertices[None], axis=2), 1)


def problem(seed, num, size):
    """A shape, the template on it, and ways by other shapes; all wrong by about `size`.

    The template is `ball(0)`, so its right map is `number`.
    """
    rng = np.random.default_rng(seed)
    mesh, number = ball(1)
    own = mesh.vertices[moved(mesh, rng, size)[number]]
    others = []
    for i in range(num):
        other, where = ball(2 + i)
        T = moved(mesh, rng, size)[number[np.argsort(where)]]
        others.append(OtherShape(other, other.vertices[where], T))
    return mesh, number, own, others


def error(mesh, number, T):
    return np.linalg.norm(mesh.vertices[T] - mesh.vertices[number], axis=1).mean()


def test_a_way_alone_is_itself():
    mesh, number, own, _ = problem(0, 0, 0.2)
    T = agreed_map(own, [], mesh)
    np.testing.assert_array_equal(mesh.vertices[T], own)


def test_more_ways_are_nearer_to_the_truth():
    mesh, number, own, others = problem(0, 8, 0.2)
    few, many = (
        error(mesh, number, agreed_map(own, some, mesh, within=WITHIN))
        for some in (others[:2], others)
    )
    alone = error(mesh, number, agreed_map(own, [], mesh))
    assert many < few < alone
    assert many < alone / 2


def test_a_wrong_way_counts_for_little():
    mesh, number, own, others = problem(1, 4, 0.05)
    opposite = OtherShape(*others[0][:2], np.roll(others[0].T, len(others[0].T) // 2))
    before, after = (
        error(mesh, number, agreed_map(own, ways, mesh, within=WITHIN))
        for ways in (others, [*others, opposite])
    )
    assert after < 1.2 * before
    # A mean without weights would be led astray.
    plain = agreed_map(own, [*others, opposite], mesh, within=1e6)
    assert error(mesh, number, plain) > 2 * before


def test_it_is_the_weighted_mean():
    mesh, _, own, others = problem(2, 3, 0.2)
    # All points are vertices, so a way leads to vertices too.
    ways = [own]
    for other, template, T in others:
        at = np.linalg.norm(template[:, None] - other.vertices[None], axis=2).argmin(1)
        ways.append(mesh.vertices[T[at]])
    area = trimesh.Trimesh(mesh.vertices, mesh.faces).area
    found = agreed_map(own, others, mesh, within=WITHIN)
    for points, at in zip(np.stack(ways, 1), found, strict=True):
        far = np.linalg.norm(points - np.median(points, 0), axis=1) / np.sqrt(area)
        weight = (1 + (far / WITHIN) ** 2) ** -2
        mean = (weight[:, None] * points).sum(0) / weight.sum()
        away = np.linalg.norm(mesh.vertices - mean, axis=1)
        # Not the number: two vertices of a ball may be equally near.
        assert away[at] <= away.min() + 1e-12


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_units_do_not_count(unit):
    mesh, _, own, others = problem(3, 4, 0.1)
    there = Mesh(unit * mesh.vertices + unit, mesh.faces)
    before = agreed_map(own, others, mesh)
    np.testing.assert_array_equal(agreed_map(unit * own + unit, others, there), before)


def test_maps_lead_to_the_shape_from_trusted_ones_only():
    sizes = 3, 4, 5, 6
    maps = {
        (a, b): Maps(np.full(sizes[a], b), np.full(sizes[b], a))
        for a, b in ((0, 1), (1, 2), (1, 3), (0, 2))
    }
    right = {(0, 1): 0.9, (1, 2): 0.9, (1, 3): 0.9, (0, 2): 0.1}
    graph = Graph(
        {edge: Matched(own, 1.0) for edge, own in maps.items()},
        [],
        right,
        Paths(1, np.array([1, -1, 1, 1]), np.ones(4)),
        np.array([True, True, True, False]),
    )
    found = dict(graph.trusted_maps(1))
    assert set(found) == {0, 2}  # 3 was left out
    for other, T in found.items():
        np.testing.assert_array_equal(T, np.full(sizes[other], 1))
    assert dict(graph.trusted_maps(0)).keys() == {1}
