"""The confidence of a vertex: its evidence against plain numpy, and what it obeys."""

import jax
import jax.numpy as jnp
import numpy as np
import oracles_evidence as oracles
import pytest

from jfsf import testing
from jfsf.geometry._surface import MOST_STRETCH
from jfsf.matching import vertex_confidence
from jfsf.matching._vertices import (
    APART,
    EIGENPAIRS,
    OFFSETS,
    TIME,
    VERTEX_EVIDENCE,
    VERTEX_FACTORS,
    changed_vertex_confidence,
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


def expected(spec, other, moved, T, other_strain):
    points, faces, target, others, mass, evals, evecs = map(
        np.asarray,
        (
            *(spec.vertices, spec.faces, other.vertices, other.faces),
            *(spec.mass, spec.evals, spec.evecs),
        ),
    )
    normal = oracles.normals(target, others)[T]
    apart = np.linalg.norm(moved - target[T], axis=1)
    alike = (oracles.normals(moved, faces) * normal).sum(1)
    misfit = 1 - alike * np.sign(mass @ alike) + apart / APART
    strain = (strain_of(points, moved, faces) + other_strain[T]) / 2
    columns = np.stack([strain, misfit], 1)
    heat = evecs @ np.diag(np.exp(-TIME * evals)) @ evecs.T @ np.diag(mass)
    return np.log(np.maximum(heat @ columns, 0) + [*OFFSETS.values()])


def test_evidence_against_numpy():
    assert K <= EIGENPAIRS
    moved = [np.asarray(m) for m in (NOISY.moved_x, NOISY.moved_y)]
    strains = [
        strain_of(np.asarray(s.vertices), m, np.asarray(s.faces))
        for s, m in zip(PAIR, moved, strict=True)
    ]
    x = expected(SPEC, OTHER, moved[0], np.asarray(MAPS.T_xy), strains[1])
    y = expected(OTHER, SPEC, moved[1], np.asarray(MAPS.T_yx), strains[0])
    found = vertex_evidence(MAPS, NOISY, PAIR)
    assert found[0].shape == (N, len(VERTEX_EVIDENCE))
    np.testing.assert_allclose(found[0], x, atol=1e-6)
    np.testing.assert_allclose(found[1], y, atol=1e-6)
    # As the factors say, too.
    share = 0.8
    logit = VERTEX_FACTORS["constant"] + VERTEX_FACTORS["likely"] * np.log(
        share / (1 - share)
    )
    logit = logit + x @ [VERTEX_FACTORS[name] for name in VERTEX_EVIDENCE]
    found = vertex_confidence(MAPS, NOISY, PAIR, share)[0]
    np.testing.assert_allclose(found, 1 / (1 + np.exp(-logit)), atol=1e-6)


def test_more_evidence_against_it_never_helps():
    assert VERTEX_FACTORS.keys() == {"constant", *VERTEX_EVIDENCE, "likely"}
    assert all(VERTEX_FACTORS[name] < -0.1 for name in VERTEX_EVIDENCE)
    assert VERTEX_FACTORS["likely"] > 0.1
    sure = [
        np.asarray(vertex_confidence(MAPS, NOISY, PAIR, p)[0])
        for p in (0.0, 0.2, 0.5, 0.9, 1.0)
    ]
    assert (np.diff(sure, axis=0) > 0).all()
    assert np.min(sure) >= 0 and np.max(sure) <= 1


def test_it_follows_the_confidence_of_the_whole_map():
    for before, now in ((0.3, 0.8), (0.999, 0.5), (0.0, 1.0)):
        old, new = (vertex_confidence(MAPS, NOISY, PAIR, p)[0] for p in (before, now))
        np.testing.assert_allclose(
            changed_vertex_confidence(old, before, now), new, rtol=1e-9
        )


def test_a_mirrored_bending_is_no_turn():
    flip = jnp.asarray([[-1.0, 1, 1]])
    points = bent(SPEC.vertices, SPEC.vertices)
    mirrored = SPEC._replace(vertices=SPEC.vertices * flip)
    one = vertex_evidence(SAME, points, (SPEC, SPEC))[0]
    # Y is the mirror image, wound as X: its normals point inward.
    moved = bent(mirrored.vertices, SPEC.vertices)
    inward = SPEC._replace(
        vertices=mirrored.vertices, faces=SPEC.faces[:, jnp.array([0, 2, 1])]
    )
    other = vertex_evidence(SAME, moved, (SPEC, inward))[0]
    np.testing.assert_allclose(one, other, atol=1e-6)


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
    likely, back = map(np.asarray, vertex_confidence(maps, aligned, (spec, spec), 0.99))
    assert likely[there].max() < likely[away > 0.3].min()
    assert likely[there].mean() < 0.5 < 0.9 < likely[away > 0.3].mean()
    assert back[away > 0.3].mean() > 0.9


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
    found = vertex_confidence(
        maps, NOISY._replace(moved_x=moved[order]), (x, OTHER), 0.9
    )
    plain = vertex_confidence(MAPS, NOISY, PAIR, 0.9)
    np.testing.assert_allclose(found[0], plain[0][order], atol=1e-8)
    np.testing.assert_allclose(found[1], plain[1], atol=1e-8)


@pytest.mark.parametrize("filler", [0.0, np.nan])
def test_padding_is_invisible(filler):
    x, y = pad(SPEC, N + 5, 330), pad(OTHER, N + 9, 340)
    maps = Maps(jnp.pad(MAPS.T_xy, (0, 5)), jnp.pad(MAPS.T_yx, (0, 9)))
    longer = lambda moved, by: jnp.pad(moved, ((0, by), (0, 0)), constant_values=filler)
    moved = bent(longer(NOISY.moved_x, 5), longer(NOISY.moved_y, 9))
    plain = vertex_confidence(MAPS, NOISY, PAIR, 0.9)
    if np.isnan(filler):  # no face of padding may touch it
        x, y = (
            s._replace(faces=own.faces) for s, own in zip((x, y), PAIR, strict=True)
        )
    padded = vertex_confidence(maps, moved, (x, y), 0.9)
    for ours, theirs in zip(padded, plain, strict=True):
        np.testing.assert_allclose(ours[:N], theirs, atol=1e-8)
        assert not ours[N:].any()


def test_vmap_is_the_loop_and_float32_agrees():
    shares = jnp.asarray([0.3, 0.9])
    both = jax.vmap(lambda p: vertex_confidence(MAPS, NOISY, PAIR, p))(shares)
    for i, share in enumerate(shares):
        one = vertex_confidence(MAPS, NOISY, PAIR, share)
        for ours, theirs in zip(both, one, strict=True):
            np.testing.assert_allclose(ours[i], theirs, atol=1e-10)
    cast = lambda leaf: leaf.astype("f4") if leaf.dtype.kind == "f" else leaf
    given = jax.tree.map(cast, (MAPS, NOISY, PAIR))
    for ours, theirs in zip(
        vertex_confidence(*given, jnp.asarray(0.9, "f4")), one, strict=True
    ):
        assert ours.dtype == "f4"
        np.testing.assert_allclose(ours, theirs, atol=1e-4)


def test_shapes_that_coincide_have_finite_derivatives():
    def mean(moved):
        x, y = vertex_confidence(SAME, bent(moved, SPEC.vertices), (SPEC, SPEC), 0.9)
        return x.mean() + y.mean()

    assert np.isfinite(jax.grad(mean)(SPEC.vertices)).all()


def test_without_bending_or_faces_it_is_not_known():
    flat = Aligned(jnp.zeros((N, 1)), jnp.zeros((N, 1)))
    cloud = OTHER._replace(faces=OTHER.faces[:0])
    padding = OTHER._replace(faces=jnp.zeros_like(OTHER.faces))
    for aligned, y in ((flat, OTHER), (NOISY, cloud), (NOISY, padding)):
        for values in vertex_confidence(MAPS, aligned, (SPEC, y), 0.9):
            assert values.shape == (N,) and np.isnan(values).all()
    for values in vertex_confidence(MAPS, NOISY, PAIR, jnp.nan):
        assert np.isnan(values).all()
