"""The distance that is left between bent shapes, against plain numpy."""

import jax.numpy as jnp
import numpy as np

from jfsf import testing
from jfsf.evidence import bending_residual
from jfsf.runtime import pad
from jfsf.types import Maps

SPEC, OTHER = testing.blob_spectrum(0, 12), testing.blob_spectrum(1, 12)
N = len(SPEC.mass)
RNG = np.random.default_rng(0)
MAPS = Maps(*(jnp.asarray(RNG.integers(N, size=N)) for _ in range(2)))


def test_against_numpy():
    expected = []
    moved = 0.1 * RNG.normal(size=(2, N, 3))
    sides = (SPEC, OTHER, moved[0], MAPS.T_xy), (OTHER, SPEC, moved[1], MAPS.T_yx)
    for spec, other, bent, T in sides:
        target, faces = np.asarray(other.vertices), np.asarray(other.faces)
        a, b, c = (target[faces[:, i]] for i in range(3))
        normal = np.zeros((N, 3))
        for corner in faces.T:
            np.add.at(normal, corner, np.cross(b - a, c - a))
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        gap = np.abs(((bent - target[T]) * normal[T]).sum(1))
        rounding = 0.08 * N**-0.5
        expected.append(np.asarray(spec.mass) @ gap - rounding)
    found = bending_residual(MAPS, *map(jnp.asarray, moved), SPEC, OTHER)
    np.testing.assert_allclose(found, np.mean(expected), rtol=1e-6)


def test_shapes_that_coincide_leave_nothing():
    same = Maps(jnp.arange(N), jnp.arange(N))
    assert bending_residual(same, SPEC.vertices, SPEC.vertices, SPEC, SPEC) == 0


def test_padding_is_invisible():
    plain = bending_residual(MAPS, SPEC.vertices, OTHER.vertices, SPEC, OTHER)
    x, y = pad(SPEC, N + 5, 330), pad(OTHER, N + 9, 340)
    longer = Maps(jnp.pad(MAPS.T_xy, (0, 5)), jnp.pad(MAPS.T_yx, (0, 9)))
    padded = bending_residual(longer, x.vertices, y.vertices, x, y)
    np.testing.assert_allclose(padded, plain, rtol=1e-12)


def test_a_point_cloud_has_no_surface():
    cloud = OTHER._replace(faces=OTHER.faces[:0])
    for other in (cloud, OTHER._replace(faces=jnp.zeros_like(OTHER.faces))):
        assert np.isnan(
            bending_residual(MAPS, SPEC.vertices, OTHER.vertices, SPEC, other)
        )
        assert np.isnan(
            bending_residual(MAPS, OTHER.vertices, SPEC.vertices, other, SPEC)
        )
