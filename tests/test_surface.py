"""Normals and cotangents, traced, against those of numpy and the Laplacian."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given

from jfsf import testing
from jfsf.geometry import normals
from jfsf.geometry._surface import (
    STIFFNESS_RANGE,
    corner_sides,
    divergence,
    opposite_edges,
    sum_at_vertices,
    surface,
)
from jfsf.mesh import MeshError, closest
from jfsf.mesh._closest import surface_tree
from jfsf.mesh._geometry import vertex_normals
from jfsf.spectral._laplacian import operators
from jfsf.types import Mesh

N, K = 162, 4
NO_LIMIT = (-np.inf, np.inf)
spectra = testing.spectra(K)


def arrays(spec):
    return spec.vertices, spec.faces, spec.mass


@pytest.mark.parametrize("seed", [0, 1])
def test_normals_are_those_of_the_host(seed):
    mesh = testing.blob(seed)
    found = normals(jnp.asarray(mesh.vertices), jnp.asarray(mesh.faces))
    np.testing.assert_allclose(found, vertex_normals(*mesh), atol=1e-12)
    assert not normals(jnp.ones((4, 3)), jnp.zeros((5, 3), int)).any()


@pytest.mark.parametrize("seed", [0, 1])
def test_the_flux_along_edges_is_the_cotangent_laplacian(seed):
    mesh = testing.blob(seed)
    points, faces = jnp.asarray(mesh.vertices), jnp.asarray(mesh.faces)
    stiffness, _ = operators(mesh, laplacian="cotan")
    at_rest = surface(points, faces, jnp.ones(N), stiffness_range=NO_LIMIT)
    values = np.random.default_rng(seed).normal(size=(N, 2))
    flux = at_rest.stiff * opposite_edges(jnp.asarray(values), faces)
    found = divergence(flux, faces, N)
    np.testing.assert_allclose(found, stiffness @ values, atol=1e-9)


@given(spec=spectra)
def test_corners(spec):
    rest = opposite_edges(spec.vertices, spec.faces)
    to, fro = corner_sides(rest)
    corner = spec.vertices[spec.faces]
    np.testing.assert_allclose(corner + to, np.roll(corner, -1, 1), atol=1e-12)
    np.testing.assert_allclose(corner + fro, np.roll(corner, -2, 1), atol=1e-12)
    np.testing.assert_allclose(rest.sum(1), 0, atol=1e-12)
    ones = jnp.ones(spec.faces.shape)
    degree = np.bincount(np.asarray(spec.faces).ravel(), minlength=N)
    np.testing.assert_array_equal(sum_at_vertices(ones, spec.faces, N), degree)


def test_a_mirrored_surface_has_the_same_cotangents():
    spec = testing.blob_spectrum(0, K)
    plain, mirrored = surface(*arrays(spec)), surface(*arrays(spec), -1.0)
    np.testing.assert_allclose(mirrored.stiff, plain.stiff, atol=1e-12)
    np.testing.assert_array_equal(mirrored.rest[..., 0], -plain.rest[..., 0])
    np.testing.assert_array_equal(mirrored.rest[..., 1:], plain.rest[..., 1:])


def test_cotangents_are_clipped_and_padding_has_none():
    # Nearly flat: two corners are sharp and the third is obtuse.
    points = jnp.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1e-4, 0]])
    faces = jnp.array([[0, 1, 2], [0, 0, 0]])
    stiff = np.asarray(surface(points, faces, jnp.ones(3)).stiff)[..., 0]
    low, high = STIFFNESS_RANGE
    np.testing.assert_allclose(stiff, [[high / 2, high / 2, low / 2], [0, 0, 0]])


def test_vmap_equals_the_loop():
    shapes = [testing.blob_spectrum(seed, K) for seed in (0, 2)]
    found = jax.vmap(surface)(*arrays(testing.stack(shapes)))
    for i, shape in enumerate(shapes):
        truth = surface(*arrays(shape))
        np.testing.assert_allclose(found.rest[i], truth.rest, atol=1e-12)
        np.testing.assert_allclose(found.stiff[i], truth.stiff, atol=1e-9)


def test_a_surface_of_single_points_is_an_error():
    with pytest.raises(MeshError, match="faces are single points"):
        surface_tree(Mesh(np.eye(3), np.zeros((2, 3), int)))
    # As padding has: most faces are no hindrance.
    ball = testing.blob(0, subdivisions=1)
    padded = np.concatenate([ball.faces, np.zeros((2 * len(ball.faces), 3), int)])
    found = closest(surface_tree(Mesh(ball.vertices, padded)), 2 * ball.vertices)
    expected = closest(surface_tree(ball), 2 * ball.vertices)
    np.testing.assert_allclose(found.distance, expected.distance)
