"""Rigid motions between a part and a whole: oracles, and motions that are known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jfsf import data
from jfsf.matching.parts import _alignments as motions
from jfsf.matching.parts import cut
from jfsf.matching.parts._alignments import _rotations, aligned, alignments, correlation
from jfsf.matching.parts._register import whole_at_rest
from jfsf.matching.parts._settings import ANY_UNIT_BANDS
from jfsf.mesh import decimate, surface_area
from jfsf.mesh._geometry import vertex_normals
from jfsf.types import Mesh

NUMBER = 8


@pytest.fixture
def fine(monkeypatch):
    """Fine enough that the right motion is found nearly.

    It need not be the first: front and back of a standing body, turned round, are
    nearly alike.
    """
    for name, value in {"ROTATIONS": 1000, "SCALES": (1.0,), "CELL": 0.08}.items():
        monkeypatch.setattr(motions, name, value)
    monkeypatch.setattr(motions, "BLUR", 0.05)


def unit(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices / np.sqrt(surface_area(mesh)), mesh.faces)


WHOLE = unit(decimate(data.load("man_walk").mesh, 500))
UP = np.array([0.3, 1.0, 0.2])
PART = cut(WHOLE, WHOLE.vertices @ UP < np.quantile(WHOLE.vertices @ UP, 0.6))


def moved(mesh: Mesh, scale: float = 1.0, seed: int = 0) -> Mesh:
    turn = Rotation.random(random_state=seed).as_matrix()
    return Mesh(scale * mesh.vertices @ turn.T + [1.0, -2.0, 0.5], mesh.faces)


def test_a_correlation_is_the_sum_over_all_shifts():
    rng = np.random.default_rng(1)
    n, blur = 8, 1.3
    x, y = rng.normal(size=(2, 3, n, n, n)), rng.normal(size=(3, n, n, n))
    # Gaussians of width `blur` of both fields make one that is sqrt(2) as wide; in a
    # period so short, the sum over all of its copies.
    ring = sum(
        np.exp(-((np.arange(n) + n * c) ** 2) / (4 * blur**2)) for c in range(-4, 5)
    )
    ring = ring / ring.sum()
    wide = np.einsum("i,j,k->ijk", ring, ring, ring)
    found = correlation(x, y[None], blur)
    for shift in ((0, 0, 0), (1, 0, 5), (7, 3, 2)):
        wanted = np.zeros(2)
        for u in np.ndindex(n, n, n):
            weight = wide[u]
            steps = tuple(-(np.array(u) + shift))
            wanted += weight * np.sum(
                x * np.roll(y, steps, (1, 2, 3))[None], (1, 2, 3, 4)
            )
        np.testing.assert_allclose(found[(slice(None), *shift)], wanted, atol=1e-4)


def test_rotations_are_rotations_and_leave_no_gap():
    turns = _rotations(400)
    eye = np.broadcast_to(np.eye(3), turns.shape)
    np.testing.assert_allclose(turns @ turns.swapaxes(1, 2), eye, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(turns), 1)
    others = Rotation.random(500, random_state=0).as_matrix()
    cosine = (np.einsum("aij,bij->ab", turns, others).max(0) - 1) / 2
    assert np.degrees(np.arccos(cosine)).max() < 30


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("scale", [1.0, 1 / 1.15])
def test_a_part_that_was_moved_is_laid_where_it_was(seed, scale, fine, monkeypatch):
    monkeypatch.setattr(motions, "SCALES", (1 / scale,))
    part = moved(PART.mesh, scale, seed)
    found = alignments(
        part, WHOLE, vertex_normals(*part), vertex_normals(*WHOLE), NUMBER
    )
    there = WHOLE.vertices[PART.index]
    away = [
        np.linalg.norm(one.apply(part.vertices) - there, axis=1).mean() for one in found
    ]
    # Half a step between rotations, at the radius of the shape, and half a cell.
    assert min(away) < 0.1
    assert np.median(away) > 0.3
    overlap = [one.overlap for one in found]
    assert overlap == sorted(overlap, reverse=True)


def test_maps_of_motions_are_those_of_nearest_vertices_that_face_the_same_way(fine):
    part = moved(PART.mesh, seed=4)
    maps = aligned(part, whole_at_rest(WHOLE, 0 * WHOLE.vertices), NUMBER)
    assert {scale for _, scale in maps} == {1.0}
    assert least_error(maps) < 0.15


def test_a_mirrored_part_is_laid_on_the_mirror_image(fine):
    flip = np.array([1, 1, -1])
    part = moved(Mesh(PART.mesh.vertices * flip, PART.mesh.faces[:, ::-1]), seed=1)
    mirrored, plain = (
        aligned(part, whole_at_rest(WHOLE, 0 * WHOLE.vertices, sign), NUMBER)
        for sign in (-1, 1)
    )
    assert least_error(mirrored) < 0.15
    assert least_error(plain) > 0.2


def test_none_are_made_where_none_are_asked_for():
    whole = whole_at_rest(WHOLE, 0 * WHOLE.vertices)
    assert aligned(PART.mesh, whole, 0) == []


def least_error(maps) -> float:
    """Of the maps of the part, mean distances in sqrt(area)."""
    right = WHOLE.vertices[PART.index]
    return min(
        np.linalg.norm(WHOLE.vertices[T] - right, axis=1).mean() for T, _ in maps
    )


def test_each_band_of_scales_keeps_its_share_and_no_two_lay_the_part_alike():
    part = moved(PART.mesh, 0.5)
    both = part, WHOLE, vertex_normals(*part), vertex_normals(*WHOLE)
    found = alignments(*both, NUMBER, same_unit=False)
    logs = np.log([one.scale for one in found])
    num = ANY_UNIT_BANDS
    ends = np.quantile(np.log(motions.ANY_SCALES), np.arange(1, num) / num)
    bands = np.digitize(logs, ends)
    assert set(bands) == set(range(num))
    assert np.bincount(bands).max() == -(-NUMBER // num)
    # Few are rounded up, or no band would have any.
    assert len(alignments(*both, 2, same_unit=False)) == num
    images = [one.apply(part.vertices) for one in found]
    for i, one in enumerate(images):
        for j, other in enumerate(images[:i]):
            if bands[i] == bands[j]:
                apart = np.linalg.norm(one - other, axis=1).mean()
                assert apart > 0.8 * motions.MIN_DISTANCE
