"""The radius of a vertex: its evidence against plain numpy, and what it obeys."""

from itertools import combinations

import jax
import jax.numpy as jnp
import numpy as np
import oracles_evidence as oracles
import pytest

from jfsf import testing
from jfsf.geometry._surface import MOST_STRETCH
from jfsf.matching import vertex_confidence, vertex_radius
from jfsf.matching._vertices import (
    CONFIDENCE_FACTORS,
    EIGENPAIRS,
    LEAST_SLOPE,
    OFFSETS,
    SIGNATURE_TIME,
    TIME,
    VERTEX_EVIDENCE,
    VERTEX_FACTORS,
    WITHIN,
    vertex_evidence,
)
from jfsf.runtime._sizes import pad
from jfsf.types import Aligned, Maps

K = 40
SPEC, OTHER = testing.blob_spectrum(0, K), testing.blob_spectrum(1, K)
N = len(SPEC.mass)
RNG = np.random.default_rng(0)
MAPS = Maps(*(jnp.asarray(RNG.integers(N, size=N)) for _ in range(2)))
SAME = Maps(jnp.arange(N), jnp.arange(N))
PAIR = SPEC, OTHER


def bent(moved_x, moved_y):
    return Aligned(jnp.zeros((N, 1)), jnp.zeros((N, 1)), moved_x, moved_y)


NOISY = bent(*(jnp.asarray(0.1 * RNG.normal(size=(N, 3))) for _ in range(2)))


def strain_of(points, moved, faces):
    """The root mean square, over the faces around, of the logarithms of stretches."""
    areas, values = oracles.stretches(points, moved, faces)
    logs = np.clip(np.log(values), -MOST_STRETCH, MOST_STRETCH)
    total, weight = np.zeros(len(points)), np.zeros(len(points))
    for face, area, both in zip(faces, areas, logs, strict=True):
        total[face] += area * (both**2).sum()
        weight[face] += area
    return np.sqrt(total / weight)


def signature_of(spec):
    """Its logarithm, and twice the mean square of its slopes along edges around."""
    evals, evecs, faces, points = map(
        np.asarray, (spec.evals, spec.evecs, spec.faces, spec.vertices)
    )
    values = np.log((evecs**2 * np.exp(-SIGNATURE_TIME * evals)).sum(1))
    rise, run = np.zeros(len(points)), np.zeros(len(points))
    for face in faces:
        for a, b in combinations(face, 2):
            rise[face] += (values[a] - values[b]) ** 2
            run[face] += ((points[a] - points[b]) ** 2).sum()
    return values, 2 * rise / run


def expected(spec, other, moved, T, strain, other_strain):
    target, mass, evals, evecs = map(
        np.asarray, (other.vertices, spec.mass, spec.evals, spec.evecs)
    )
    (own, slope), (others, other_slope) = signature_of(spec), signature_of(other)
    columns = [
        (own - others[T]) ** 2,
        (slope + other_slope[T]) / 2,
        (strain + other_strain[T]) / 2,
        np.linalg.norm(moved - target[T], axis=1),
    ]
    heat = evecs @ np.diag(np.exp(-TIME * evals)) @ evecs.T @ np.diag(mass)
    differ, slope, strain, apart = np.maximum(heat @ np.stack(columns, 1), 0).T
    shift = np.sqrt(differ / (slope + LEAST_SLOPE))
    return np.log(np.stack([shift, strain, apart], 1) + [*OFFSETS.values()])


def test_evidence_against_numpy():
    assert K <= EIGENPAIRS
    moved = [np.asarray(m) for m in (NOISY.moved_x, NOISY.moved_y)]
    strains = [
        strain_of(np.asarray(s.vertices), m, np.asarray(s.faces))
        for s, m in zip(PAIR, moved, strict=True)
    ]
    x = expected(SPEC, OTHER, moved[0], np.asarray(MAPS.T_xy), *strains)
    y = expected(OTHER, SPEC, moved[1], np.asarray(MAPS.T_yx), *strains[::-1])
    found = vertex_evidence(MAPS, NOISY, PAIR)
    assert found[0].shape == (N, len(VERTEX_EVIDENCE))
    np.testing.assert_allclose(found[0], x, atol=1e-6)
    np.testing.assert_allclose(found[1], y, atol=1e-6)
    # As the factors say, too.
    log_radius = x @ [VERTEX_FACTORS[name] for name in VERTEX_EVIDENCE]
    radius = np.exp(log_radius + VERTEX_FACTORS["constant"])
    np.testing.assert_allclose(vertex_radius(MAPS, NOISY, PAIR)[0], radius, rtol=1e-6)


def test_the_confidence_is_that_of_the_radius():
    radius = jnp.asarray([0.0, WITHIN / 2, WITHIN, 2 * WITHIN, jnp.inf])
    found = np.asarray(vertex_confidence(radius, 0.8))
    constant, margin, likely = CONFIDENCE_FACTORS.values()
    logits = constant + likely * np.log(4) + margin * np.log([2, 1, 0.5])
    np.testing.assert_allclose(found, [1, *1 / (1 + np.exp(-logits)), 0], atol=1e-12)
    assert (np.diff(found) < 0).all()
    shares = [vertex_confidence(radius[2], p) for p in (0.0, 0.2, 0.5, 0.9, 1.0)]
    assert (np.diff(shares) > 0).all()
    assert np.isnan(vertex_confidence(radius, jnp.nan)).all()
    assert np.isnan(vertex_confidence(jnp.asarray([jnp.nan]), 0.8)).all()


def test_more_evidence_against_it_never_makes_the_radius_smaller():
    assert VERTEX_FACTORS.keys() == {"constant", *VERTEX_EVIDENCE}
    assert all(VERTEX_FACTORS[name] > 0.05 for name in VERTEX_EVIDENCE)
    # Farther apart everywhere, and bent as much.
    moved = NOISY.moved_x, NOISY.moved_y
    farther = bent(*(m + 1.0 for m in moved if m is not None))
    near, far = (vertex_radius(MAPS, one, PAIR) for one in (NOISY, farther))
    for before, after in zip(near, far, strict=True):
        assert (after > before).all()


def test_a_damaged_map_is_doubted_just_there():
    spec = testing.blob_spectrum(0, K, 3)
    n, points = len(spec.mass), np.asarray(spec.vertices)
    away = np.linalg.norm(points - points[7], axis=1)
    there = away < 0.1
    T = np.arange(n)
    T[there] = np.random.default_rng(1).permutation(np.flatnonzero(away > 0.4))[
        : there.sum()
    ]
    maps = Maps(jnp.asarray(T), jnp.arange(n))
    # The bending follows the map.
    aligned = Aligned(spec.evecs, spec.evecs, jnp.asarray(points[T]), spec.vertices)
    radius, back = map(np.asarray, vertex_radius(maps, aligned, (spec, spec)))
    assert radius[there].min() > radius[away > 0.4].max()
    assert radius[there].mean() > 3 * max(radius[away > 0.4].mean(), back.mean())


def test_relabelling_vertices_relabels_the_answer():
    order = RNG.permutation(N)
    place = np.argsort(order)
    x = SPEC._replace(
        evecs=SPEC.evecs[order],
        mass=SPEC.mass[order],
        vertices=SPEC.vertices[order],
        faces=jnp.asarray(place)[SPEC.faces],
    )
    maps = Maps(MAPS.T_xy[order], jnp.asarray(place)[MAPS.T_yx])
    moved = NOISY.moved_x
    assert moved is not None
    found = vertex_radius(maps, NOISY._replace(moved_x=moved[order]), (x, OTHER))
    plain = vertex_radius(MAPS, NOISY, PAIR)
    np.testing.assert_allclose(found[0], plain[0][order], atol=1e-8)
    np.testing.assert_allclose(found[1], plain[1], atol=1e-8)


@pytest.mark.parametrize("filler", [0.0, np.nan])
def test_padding_is_invisible(filler):
    x, y = pad(SPEC, N + 5, 330), pad(OTHER, N + 9, 340)
    maps = Maps(jnp.pad(MAPS.T_xy, (0, 5)), jnp.pad(MAPS.T_yx, (0, 9)))
    longer = lambda moved, by: jnp.pad(moved, ((0, by), (0, 0)), constant_values=filler)
    moved = bent(longer(NOISY.moved_x, 5), longer(NOISY.moved_y, 9))
    plain = vertex_radius(MAPS, NOISY, PAIR)
    if np.isnan(filler):  # no face of padding may touch it
        x, y = (
            s._replace(faces=own.faces) for s, own in zip((x, y), PAIR, strict=True)
        )
    padded = vertex_radius(maps, moved, (x, y))
    for ours, theirs in zip(padded, plain, strict=True):
        np.testing.assert_allclose(ours[:N], theirs, atol=1e-8)
        assert np.isinf(ours[N:]).all()


def test_vmap_is_the_loop_and_float32_agrees():
    moved = jnp.stack([NOISY.moved_x, NOISY.moved_x + 0.3])  # type: ignore
    find = lambda points: vertex_radius(MAPS, NOISY._replace(moved_x=points), PAIR)
    both = jax.vmap(find)(moved)
    for i, points in enumerate(moved):
        for ours, theirs in zip(both, find(points), strict=True):
            np.testing.assert_allclose(ours[i], theirs, atol=1e-10)
    cast = lambda leaf: leaf.astype("f4") if leaf.dtype.kind == "f" else leaf
    given = jax.tree.map(cast, (MAPS, NOISY, PAIR))
    for ours, theirs in zip(
        vertex_radius(*given), vertex_radius(MAPS, NOISY, PAIR), strict=True
    ):
        assert ours.dtype == vertex_confidence(ours, 0.9).dtype == "f4"
        np.testing.assert_allclose(ours, theirs, rtol=1e-3)


def test_shapes_that_coincide_have_finite_derivatives():
    def mean(moved):
        radius = vertex_radius(SAME, bent(moved, SPEC.vertices), (SPEC, SPEC))
        return sum(vertex_confidence(side, 0.9).mean() for side in radius)

    assert np.isfinite(jax.grad(mean)(SPEC.vertices)).all()


def test_without_bending_or_faces_it_is_not_known():
    flat = Aligned(jnp.zeros((N, 1)), jnp.zeros((N, 1)))
    cloud = OTHER._replace(faces=OTHER.faces[:0])
    padding = OTHER._replace(faces=jnp.zeros_like(OTHER.faces))
    for aligned, y in ((flat, OTHER), (NOISY, cloud), (NOISY, padding)):
        for values in vertex_radius(MAPS, aligned, (SPEC, y)):
            assert values.shape == (N,) and np.isnan(values).all()
