"""Residual and distortion of bent shapes, against plain numpy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jfsf import testing
from jfsf.array import pad
from jfsf.evaluate import bending
from jfsf.types import Maps

SPEC, OTHER = testing.blob_spectrum(0, 12), testing.blob_spectrum(1, 12)
N = len(SPEC.mass)


def embeddings(bent_x, bent_y, x=SPEC, y=OTHER):
    filler_x, filler_y = jnp.zeros((len(x.mass), 6)), jnp.zeros((len(y.mass), 6))
    emb_x = jnp.concatenate([bent_x, x.vertices, filler_x], 1)
    return emb_x, jnp.concatenate([y.vertices, bent_y, filler_y], 1)


def random_maps():
    rng = np.random.default_rng(0)
    return Maps(*(jnp.asarray(rng.integers(N, size=N)) for _ in range(2)))


@pytest.mark.parametrize("size", [1, 3])
def test_a_similarity_distorts_nothing(size):
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    same = Maps(jnp.arange(N), jnp.arange(N))
    bent = size * SPEC.vertices @ turn
    found = bending(same, *embeddings(bent, bent, SPEC, SPEC), SPEC, SPEC)
    assert abs(found.distortion) < 1e-6
    gap = np.linalg.norm(bent - SPEC.vertices, axis=1)
    assert np.isclose(found.residual, gap @ np.asarray(SPEC.mass))


def test_singular_values_of_triangles():
    rng = np.random.default_rng(2)
    maps = random_maps()
    moved = [
        np.asarray(s.vertices + 0.1 * rng.normal(size=(N, 3))) for s in (SPEC, OTHER)
    ]
    found = bending(maps, *embeddings(*map(jnp.asarray, moved)), SPEC, OTHER)
    ratio, gap = [], []
    sides = (SPEC, OTHER, moved[0], maps.T_xy), (OTHER, SPEC, moved[1], maps.T_yx)
    for spec, other, bent, T in sides:
        rest, mass = np.asarray(spec.vertices), np.asarray(spec.mass)
        gap.append(mass @ np.linalg.norm(bent - np.asarray(other.vertices)[T], axis=1))
        logs, areas = [], []
        for i, j, k in np.asarray(spec.faces):
            legs = np.stack([rest[j] - rest[i], rest[k] - rest[i]], 1)
            length = np.linalg.qr(legs)[1]
            edges = np.stack([bent[j] - bent[i], bent[k] - bent[i]], 1)
            stretch = np.linalg.svd(edges @ np.linalg.inv(length))[1]
            logs.append(min(np.log(stretch[0] / stretch[1]), 4))
            areas.append(abs(np.linalg.det(length)))
        ratio.append(np.average(logs, weights=areas))
    assert np.isclose(found.residual, np.mean(gap))
    assert np.isclose(found.distortion, np.mean(ratio))


def test_padding_is_invisible():
    maps = random_maps()
    plain = bending(maps, *embeddings(SPEC.vertices, OTHER.vertices), SPEC, OTHER)
    x, y = pad(SPEC, N + 5, 330), pad(OTHER, N + 9, 340)
    longer = Maps(jnp.pad(maps.T_xy, (0, 5)), jnp.pad(maps.T_yx, (0, 9)))
    padded = bending(longer, *embeddings(x.vertices, y.vertices, x, y), x, y)
    np.testing.assert_allclose(padded, plain, rtol=1e-12)


def test_derivatives_are_finite_where_shapes_coincide():
    same = Maps(jnp.arange(N), jnp.arange(N))

    def total(bent):
        return sum(bending(same, *embeddings(bent, bent, SPEC, SPEC), SPEC, SPEC))

    assert np.isfinite(jax.grad(total)(SPEC.vertices)).all()
