"""What the ends of limbs look like: total curvatures and slenderness."""

import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from jfsf.initial._samples import tip_descriptors, total_curvatures
from jfsf.types import Spectrum


def total(mesh, scale=1.0, padding=0):
    """Both curvatures of a whole mesh, as those of a single cell."""
    vertices = np.pad(scale * mesh.vertices, ((0, padding), (0, 0)))
    faces = np.pad(mesh.faces, ((0, padding), (0, 0)))
    mass = np.pad(np.full(len(mesh.vertices), 1 / len(mesh.vertices)), (0, padding))
    n = len(mass)
    spec = Spectrum(
        evals=jnp.zeros(1),
        evecs=jnp.zeros((n, 1)),
        mass=jnp.asarray(mass, jnp.float32),
        vertices=jnp.asarray(vertices, jnp.float32),
        faces=jnp.asarray(faces, jnp.int32),
    )
    cells = jnp.zeros((n, 2), jnp.int32)
    return np.asarray(total_curvatures(spec, jnp.zeros(1, jnp.int32), cells))[0]


SPHERE = trimesh.creation.icosphere(subdivisions=3)


@pytest.mark.parametrize(("scale", "padding"), [(1.0, 0), (7.0, 0), (1.0, 5)])
def test_a_sphere_has_four_pi_of_either_curvature(scale, padding):
    found = total(SPHERE, scale, padding)
    np.testing.assert_allclose(found, 4 * np.pi, rtol=0.01)


def test_a_torus_has_twice_the_gaussian_curvature_of_a_sphere():
    # |K| of a torus integrates to 8 pi; H^2 to pi^2 / (r sqrt(1 - r^2)), r = 1/3.
    torus = trimesh.creation.torus(3.0, 1.0, major_sections=160, minor_sections=80)
    gaussian, willmore = total(torus)
    np.testing.assert_allclose(gaussian, 8 * np.pi, rtol=0.01)
    np.testing.assert_allclose(willmore, np.pi**2 * 9 / np.sqrt(8), rtol=0.02)


def test_a_border_is_not_curved():
    corner = SPHERE.vertices[:, 2] > 0.1
    flat = trimesh.creation.box().subdivide().subdivide()
    flat.update_faces(flat.triangles_center[:, 2] > 0.49)
    flat.remove_unreferenced_vertices()
    np.testing.assert_allclose(total(flat), 0, atol=1e-5)
    cap = SPHERE.copy()
    cap.update_faces(corner[cap.faces].all(1))
    cap.remove_unreferenced_vertices()
    gaussian, willmore = total(cap)
    assert 0.5 * 4 * np.pi > gaussian > 0.3 * 4 * np.pi
    assert 0.5 * 4 * np.pi > willmore > 0.3 * 4 * np.pi


def test_looks_are_those_of_the_end_alone():
    # Two limbs of samples on a line, the middle between them; one is half as wide.
    line = np.linspace(-1, 1, 41)
    geodesics = np.abs(np.array([-1, 1])[:, None] - line[None])
    width = np.where(line < 0, 1.0, 0.5)
    curved = np.stack(
        [np.where(line < -0.92, 3.0, 0), np.where(line > 0.92, 2.0, 0)], 1
    )
    share = jnp.asarray(width / width.sum())
    far = jnp.asarray(geodesics)
    slender, gaussian, willmore = tip_descriptors(
        far, jnp.ones(2), share, jnp.asarray(curved)
    ).T
    np.testing.assert_allclose(slender[0] - slender[1], np.log(2), atol=0.05)
    # Samples -1, -0.95 and 1, 0.95 lie well inside.
    np.testing.assert_allclose(gaussian, np.log([1 + 6, 1]), atol=0.05)
    np.testing.assert_allclose(willmore, np.log([1, 1 + 4]), atol=0.05)
    longer = tip_descriptors(3 * far, 3 * jnp.ones(2), share, jnp.asarray(curved))
    np.testing.assert_allclose(longer[:, 0] - slender, -2 * np.log(3), atol=1e-4)
