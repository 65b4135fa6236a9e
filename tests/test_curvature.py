"""The curvature descriptor: exact on a sphere, and what must not change it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings

from jfsf import testing
from jfsf.geometry import normals
from jfsf.runtime._sizes import pad
from jfsf.spectral import curvature, spectrum
from jfsf.spectral._descriptors import CURVATURE_TIMES
from jfsf.types import Mesh

K, N = 40, 162
STEPS = len(CURVATURE_TIMES) - 1


def spec_of(mesh):
    return testing.cast(spectrum(mesh, K, tol=1e-9, cache=False))


def test_a_sphere_shrinks_at_the_known_rate():
    # Coordinates are eigenfunctions: of area 1 the radius decays as exp(-8 pi t).
    ball = trimesh.creation.icosphere(subdivisions=4)
    found = curvature(spec_of(Mesh(np.array(ball.vertices), np.array(ball.faces))))
    radius = np.exp(-8 * np.pi * np.array(CURVATURE_TIMES)) / np.sqrt(4 * np.pi)
    exact = np.broadcast_to(radius[:-1] - radius[1:], (len(found), STEPS))
    np.testing.assert_allclose(found[:, :STEPS], exact, rtol=0.01)
    np.testing.assert_allclose(found[:, STEPS:], exact, rtol=0.01)


def test_dents_are_negative():
    ball = trimesh.creation.icosphere(subdivisions=3)
    v = np.array(ball.vertices)
    v *= 1 - 0.5 * np.exp(-8 * (1 - v[:, 2:]))
    found = curvature(spec_of(Mesh(v, np.array(ball.faces))))
    top, bottom = v[:, 2].argmax(), v[:, 2].argmin()
    pit = np.linalg.norm(v, axis=1).argmin()
    # At coarse scales there is no pit.
    assert (found[pit, :4] < 0).all() and (found[bottom, :STEPS] > 0).all()
    assert (found[top, STEPS:] > 0).all()


@settings(max_examples=5)
@given(testing.meshes(), testing.motions(), testing.permutations(N))
def test_motion_units_mirroring_and_labels_change_nothing(mesh, motion, order):
    plain = np.asarray(curvature(spec_of(mesh)))
    for other in (testing.move(mesh, motion, unit=1000.0), testing.mirror(mesh)):
        np.testing.assert_allclose(curvature(spec_of(other)), plain, atol=1e-7)
    moved = curvature(spec_of(testing.relabel(mesh, order)))
    np.testing.assert_allclose(moved, plain[order], atol=1e-7)


@given(testing.spectra(K), testing.signs(K))
def test_signs_of_eigenvectors_change_nothing(spec, by):
    np.testing.assert_allclose(
        curvature(testing.flip_signs(spec, by)), curvature(spec), atol=1e-12
    )


def test_padding_is_invisible():
    spec = testing.blob_spectrum(0, K)
    padded = np.asarray(curvature(pad(spec, N + 5, 330)))
    np.testing.assert_allclose(padded[:N], curvature(spec), atol=1e-12)
    assert not padded[N:].any()


def test_without_faces_only_lengths_are_left():
    spec = testing.blob_spectrum(0, K)
    cloud = np.asarray(curvature(spec._replace(faces=spec.faces[:0])))
    assert not cloud[:, :STEPS].any()
    np.testing.assert_allclose(cloud[:, STEPS:], curvature(spec)[:, STEPS:])


def test_float32_vmap_and_gradients():
    specs = [testing.blob_spectrum(seed, K) for seed in (0, 1)]
    batch = jax.vmap(curvature)(testing.stack(specs))
    for found, spec in zip(batch, specs, strict=True):
        exact = np.asarray(curvature(spec))
        np.testing.assert_allclose(found, exact, atol=1e-12)
        low = np.asarray(curvature(testing.cast(spec, jnp.float32)))
        assert low.dtype == np.float32
        np.testing.assert_allclose(low, exact, atol=1e-5)
    slope = jax.grad(lambda v: curvature(specs[0]._replace(vertices=v)).sum())
    assert jnp.isfinite(slope(specs[0].vertices)).all()
    # A length of 0 has no derivative, but must not give nan.
    assert jnp.isfinite(slope(jnp.zeros_like(specs[0].vertices))).all()


@pytest.mark.parametrize("dtype", ["f4", "f8"])
def test_the_tip_of_a_fin_has_no_normal(dtype):
    # Two faces back to back: what is left of their normals is rounding.
    vertices, faces = testing.blob(0)
    tip = len(vertices)
    fin = np.array([[0, 1, tip], [1, 0, tip]])
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    points = np.concatenate([vertices, [[0.3, 0.7, 1.1]]]) @ turn + (0.1, 0.2, 0.3)
    points = jnp.asarray(points, dtype)
    found = normals(points, jnp.asarray(np.concatenate([faces, fin])))
    assert found.dtype == dtype and not found[tip].any()
    plain = normals(points, jnp.asarray(faces))
    np.testing.assert_allclose(found[:tip], plain[:tip], atol=1e-5)
    np.testing.assert_allclose(jnp.linalg.norm(found[:tip], axis=1), 1, rtol=1e-5)
