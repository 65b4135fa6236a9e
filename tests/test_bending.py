"""What is left between bent shapes, and what it costs, against plain numpy."""

import jax
import jax.numpy as jnp
import numpy as np
import oracles_evidence as oracles
import pytest

from jfsf import testing
from jfsf.geometry._surface import MOST_STRETCH, log_stretches
from jfsf.matching._certificate import MOST_SHEARED, Bending, bending
from jfsf.runtime._sizes import pad
from jfsf.types import Maps

SPEC, OTHER = testing.blob_spectrum(0, 12), testing.blob_spectrum(1, 12)
N = len(SPEC.mass)
RNG = np.random.default_rng(0)
MAPS = Maps(*(jnp.asarray(RNG.integers(N, size=N)) for _ in range(2)))
SAME = Maps(jnp.arange(N), jnp.arange(N))
NOISE = 0.05 * RNG.normal(size=(2, N, 3))
MOVED = SPEC.vertices + NOISE[0], OTHER.vertices + NOISE[1]


def plain(spec):
    return tuple(np.asarray(a) for a in (spec.vertices, spec.faces, spec.mass))


@pytest.mark.parametrize("dtype, atol", [(jnp.float64, 1e-7), (jnp.float32, 1e-3)])
def test_against_numpy(dtype, atol):
    sides = (SPEC, MOVED[0], OTHER, MAPS.T_xy), (OTHER, MOVED[1], SPEC, MAPS.T_yx)
    both = [
        oracles.bending(
            *(plain(spec), np.asarray(moved), plain(other), np.asarray(T)),
            *(0.08, MOST_SHEARED, MOST_STRETCH),
        )
        for spec, moved, other, T in sides
    ]
    specs = (testing.cast(spec, dtype) for spec in (SPEC, OTHER))
    found = bending(MAPS, *(m.astype(dtype) for m in MOVED), *specs)
    assert all(figure.dtype == dtype and figure.shape == () for figure in found)
    np.testing.assert_allclose(found, np.mean(both, 0), atol=atol)


def test_shapes_that_coincide_leave_nothing():
    found = bending(SAME, SPEC.vertices, SPEC.vertices, SPEC, SPEC)
    # The root of a rounding error.
    np.testing.assert_allclose(found, 0, atol=1e-6)
    twice = bending(SAME, 2 * SPEC.vertices, 2 * SPEC.vertices, SPEC, SPEC)
    np.testing.assert_allclose(twice[1:], 0, atol=1e-6)  # it grows evenly


def test_what_is_sheared_in_a_small_part_counts():
    top = np.argsort(np.asarray(SPEC.vertices[:, 2]))[-10:]
    moved = SPEC.vertices.at[top, 0].add(0.3)
    found = bending(SAME, moved, moved, SPEC, SPEC)
    assert found.shear > 0.3 > 0.1 > found.residual


def test_a_mirror_image_is_not_turned():
    flip = jnp.asarray([[-1.0, 1, 1]])
    # Y is the mirror image of X, wound outward.
    other = SPEC._replace(
        vertices=SPEC.vertices * flip, faces=SPEC.faces[:, jnp.array([0, 2, 1])]
    )
    found = bending(SAME, other.vertices, SPEC.vertices, SPEC, other)
    np.testing.assert_allclose(found, 0, atol=1e-6)


def test_padding_is_invisible():
    known = bending(MAPS, *MOVED, SPEC, OTHER)
    x, y = pad(SPEC, N + 5, 330), pad(OTHER, N + 9, 340)
    longer = Maps(jnp.pad(MAPS.T_xy, (0, 5)), jnp.pad(MAPS.T_yx, (0, 9)))
    moved = jnp.pad(MOVED[0], ((0, 5), (0, 0))), jnp.pad(MOVED[1], ((0, 9), (0, 0)))
    padded = bending(longer, *moved, x, y)
    np.testing.assert_allclose(padded, known, rtol=1e-9)


def test_numbers_of_vertices_and_faces_do_not_count():
    known = bending(MAPS, *MOVED, SPEC, OTHER)
    order = jnp.asarray(RNG.permutation(N))
    new = jnp.zeros(N, int).at[order].set(jnp.arange(N))
    faces = new[SPEC.faces][jnp.asarray(RNG.permutation(len(SPEC.faces)))]
    mixed = SPEC._replace(
        vertices=SPEC.vertices[order], mass=SPEC.mass[order], faces=faces
    )
    maps = Maps(MAPS.T_xy[order], new[MAPS.T_yx])
    found = bending(maps, MOVED[0][order], MOVED[1], mixed, OTHER)
    np.testing.assert_allclose(found, known, rtol=1e-9)


def test_vmap_is_the_loop():
    pairs = [(SPEC, OTHER, *MOVED), (OTHER, SPEC, *MOVED[::-1])]
    one = lambda x, y, moved_x, moved_y: bending(MAPS, moved_x, moved_y, x, y)
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *pairs)
    found = jax.vmap(one)(*stacked)
    for i, pair in enumerate(pairs):
        np.testing.assert_allclose([f[i] for f in found], one(*pair), rtol=1e-9)


def test_a_point_cloud_has_no_surface():
    cloud = OTHER._replace(faces=OTHER.faces[:0])
    for other in (cloud, OTHER._replace(faces=jnp.zeros_like(OTHER.faces))):
        for x, y in ((SPEC, other), (other, SPEC)):
            found = bending(MAPS, x.vertices, y.vertices, x, y)
            assert isinstance(found, Bending) and np.isnan(found).all()


@pytest.mark.parametrize("dtype, atol", [(jnp.float64, 1e-7), (jnp.float32, 2e-3)])
def test_stretches_are_singular_values(dtype, atol):
    rest, moved = SPEC.vertices.astype(dtype), MOVED[0].astype(dtype)
    area, smaller, larger = log_stretches(rest, moved, SPEC.faces)
    areas, values = oracles.stretches(
        np.asarray(SPEC.vertices), np.asarray(MOVED[0]), np.asarray(SPEC.faces)
    )
    assert area.dtype == smaller.dtype == larger.dtype == dtype
    np.testing.assert_allclose(area, areas, rtol=100 * atol)
    logs = np.clip(np.log(values), -MOST_STRETCH, MOST_STRETCH)
    np.testing.assert_allclose(jnp.stack([smaller, larger], 1), logs, atol=10 * atol)
    assert bool((smaller <= larger).all())


def test_stretches_of_broken_faces_are_finite_with_their_derivatives():
    # Whole, a needle, a face of padding, and one that does not move.
    rest = jnp.asarray([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0], [0, 0, 1]])
    faces = jnp.asarray([[0, 1, 2], [0, 1, 3], [0, 0, 0], [0, 1, 4]])
    onto_point, onto_line = jnp.zeros((5, 3)), rest * jnp.asarray([[1.0, 0, 0]])
    for moved in (onto_point, onto_line, rest):
        area, *logs = log_stretches(rest, moved, faces)
        np.testing.assert_allclose(area, [0.5, 0, 0, 0.5], atol=1e-12)
        assert np.isfinite(logs).all() and np.abs(logs).max() <= MOST_STRETCH
        total = lambda *both: sum(a.sum() for a in log_stretches(*both, faces))
        slopes = jax.grad(total, argnums=(0, 1))(rest, moved)
        assert np.isfinite(slopes).all()
